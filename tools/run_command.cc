#include "tools/run_command.h"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <opencv2/core.hpp>

#include "daemon/control/stop_signal.h"
#include "io/maps/marker_corners.h"
#include "io/text/number_text.h"
#include "slam/covariance/constraint_check.h"
#include "slam/final_map.h"
#include "slam/map/world_reference.h"
#include "slam/slam.h"
#include "tools/diagnosis/grey_image.h"
#include "tools/diagnosis/run_verdict.h"
#include "tools/diagnosis/source_report.h"
#include "tools/exit_code.h"
#include "tools/marker_arguments.h"
#include "tools/number_arguments.h"
#include "tools/progress_bar.h"
#include "tools/run_diagnosis.h"
#include "tools/run_input.h"
#include "tools/run_record.h"
#include "tools/run_results.h"
#include "tools/run_setup.h"
#include "tools/stage_timer.h"

namespace waymark::tools {
namespace {

// Of a camera, which goes on for ever; 2.3 kB a frame. An hour at 30 Hz.
constexpr std::size_t kCameraFrames = 108'000;

// Every frame. Returns why there are more than were processed; empty when there are not. What goes
// wrong before anything was found is an error.
Result<std::string> processAll(RunInput& input, const daemon::StopSignal& stop, slam::Slam& slam,
                               StageTimer& timer, LateResults* late, bool show_progress,
                               RunRecord* record) {
  ProgressBar bar(input.frameCount(), show_progress);
  for (;;) {
    // A camera goes on until somebody stops it.
    if (stop.pending()) {
      return input.endless() ? std::string()
                             : "interrupted after " + std::to_string(record->frames()) + " frames";
    }
    const Result<std::optional<RunInput::Step>> step = input.step(slam, timer, late);
    if (!step) {
      if (input.endless()) {
        std::fprintf(stderr, "waymark: %s; that was the end\n", step.error().message.c_str());
        return std::string();
      }
      if (record->localized() == 0) return step.error();
      return step.error().message;
    }
    if (!step.value()) return std::string();
    record->add((*step)->time_ns, (*step)->result, slam.counters(), slam.lens().state);
    bar.update(static_cast<std::int64_t>(record->frames()), [&] {
      return "localized " + io::fixed(record->localizedPercent(), 1) + " %  " +
             std::to_string(slam.map().markers().size()) + " markers";
    });
  }
}

// Why the world is not the one that was asked for; usually empty.
std::string otherWorldReason(const slam::Options& options,
                             const std::vector<const slam::Map*>& pieces) {
  const slam::MarkerOptions& markers = options.markers;
  if (!options.mapping) return {};
  const auto is_placed = [&](int id) {
    return std::ranges::any_of(
        pieces, [id](const slam::Map* map) { return map->findPosed(id) != nullptr; });
  };
  const auto has_pose = [&](const slam::Anchor& a) { return is_placed(a.id); };
  const std::string other = "; the world is another one";
  if (markers.origin_marker && !is_placed(*markers.origin_marker)) {
    return "the origin marker " + std::to_string(*markers.origin_marker) + " was never placed" +
           other;
  }
  const auto is_in_survey = [&](const slam::Map* map) { return slam::isInSurvey(*map, markers); };
  if (std::ranges::any_of(pieces, is_in_survey)) return {};
  if (!markers.anchors.empty() && std::ranges::none_of(markers.anchors, has_pose)) {
    return "none of the anchors was ever placed" + other;
  }
  if (!markers.constraints.positions.empty()) {
    return "too few of the surveyed positions were ever placed, or they lie in a line" + other;
  }
  return {};
}

// What surveyors and floor plans say, and the map does not bear out: a line each.
void tellOfContradictions(const slam::MarkerOptions& markers,
                          const std::vector<const slam::Map*>& pieces) {
  for (const std::string& line :
       slam::contradictionLines(slam::contradictions(pieces, markers), markers)) {
    std::fprintf(stderr, "waymark: warning: %s\n", line.c_str());
  }
}

void announce(const RunArguments& arguments, const RunSetup& setup) {
  if (!arguments.quiet) {
    std::fprintf(stderr, "%s\n", setup.input->description().c_str());
    if (!setup.calibration_change.empty()) {
      std::fprintf(stderr, "%s: %s\n", arguments.calibration.c_str(),
                   setup.calibration_change.c_str());
    }
  }

  if (setup.old_map) {
    for (const std::string& warning : setup.old_map->warnings) {
      std::fprintf(stderr, "waymark: warning: %s\n", warning.c_str());
    }
  }
}

// Of the source's frames, in the results.
void tellWhatIsMissing(const RunInput& input, const RunRecord& record,
                       const std::string& incomplete) {
  if (const std::string damage = input.damage(); !damage.empty()) {
    std::fprintf(stderr, "waymark: warning: %s\n", damage.c_str());
  }
  if (record.forgotten() > 0) {
    std::fprintf(stderr, "waymark: warning: the results have only the last %zu frames\n",
                 record.frames() - record.forgotten());
  }
  if (!incomplete.empty()) {
    std::fprintf(stderr, "waymark: %s; the results are of the frames before\n", incomplete.c_str());
  }
}

void printSummary(const RunRecord& record, const slam::Slam& slam, const StageTimer& timer) {
  std::size_t markers = 0;
  const std::vector<const slam::Map*> pieces = slam.pieces();
  for (const slam::Map* map : pieces) {
    markers += io::posedMarkerCorners(*map).size();
  }
  const std::string in_pieces =
      pieces.size() > 1 ? " in " + std::to_string(pieces.size()) + " pieces" : std::string();
  std::printf(
      "%zu frames, %zu localized (%.1f %%), %zu markers%s, %zu keyframes, %.2f ms a frame\n",
      record.frames(), record.localized(), record.localizedPercent(), markers, in_pieces.c_str(),
      keyframesOf(slam),
      timer.totalWall_ms() / std::max<double>(1.0, static_cast<double>(record.frames())));
}

// A calibration that the markers contradict, or have measured better; or what they say where there
// is none.
void tellOfLens(const RunArguments& arguments, bool lens_given, const slam::Slam& slam) {
  const slam::LensKnowledge& lens = slam.lens();
  if (lens_given && lens.state == slam::LensState::kGiven) return;
  const std::string& file = arguments.calibration;
  const std::string name = !lens_given ? "" : file.empty() ? "the lens known beforehand" : file;
  const auto finding = diagnosis::lensFinding(name, lens, slam.camera().calibration().fx);
  const bool all_is_well = !lens_given && finding.level == diagnosis::Finding::Level::kGood;
  if (!(all_is_well && arguments.quiet)) {
    std::fprintf(stderr, "waymark: %s\n", finding.text.c_str());
  }
  for (const slam::EarlierLens& earlier : lens.earlier) {
    std::fprintf(stderr, "waymark: the lens changed under way, at %.2f s\n",
                 1e-9 * static_cast<double>(earlier.until_ns));
  }
}

Result<ExitCode> run(const RunArguments& arguments) {
  // The SLAM is one thread; OpenCV's pool would blur its timing and gain nothing.
  cv::setNumThreads(1);
  // A signal ends the frames, and what there is by then is written all the same. Before anything is
  // opened: decoders start threads, which must not take it either.
  const daemon::StopSignal stop;
  Result<RunSetup> prepared = prepareRun(arguments);
  if (!prepared) return prepared.error();
  RunSetup& setup = prepared.value();
  announce(arguments, setup);
  slam::Slam slam(setup.camera, setup.dictionary, setup.options,
                  setup.old_map ? setup.old_map->file.map : slam::Map(),
                  setup.old_map ? setup.old_map->file.other_pieces : std::vector<slam::Map>());
  const std::size_t max_frames =
      setup.input->endless() ? kCameraFrames : std::numeric_limits<std::size_t>::max();
  StageTimer timer(max_frames);
  RunRecord record(max_frames);
  diagnosis::ImageSamples samples;
  setup.input->setImageObserver([&](const ImageView& image) { samples.add(image); });
  const Result<std::string> incomplete =
      processAll(*setup.input, stop, slam, timer, setup.late.get(),
                 /*show_progress=*/!arguments.quiet, &record);
  if (!incomplete) return incomplete.error();
  tellWhatIsMissing(*setup.input, record, *incomplete);
  bool complete = incomplete->empty();
  const auto note = [&](const Status& written) {
    if (written) return;
    std::fprintf(stderr, "waymark: %s\n", written.error().message.c_str());
    complete = false;
  };
  if (setup.detections) {
    note(writeDetections(arguments.save_detections, record, setup.camera, *setup.detections));
  }
  if (setup.input->unorderedImages() && setup.options.mapping && !setup.old_map) {
    record.placeInOrder(&slam);
  }
  const diagnosis::Verdict verdict =
      judgeRun(record, slam, setup.options, setup.dictionary.name(), samples);
  slam::makeFinalMap(record.liveFrames(),
                     {.unordered_images = setup.input->unorderedImages(),
                      .optimize = !arguments.no_global,
                      .refine_intrinsics = arguments.refine_intrinsics},
                     &slam);
  tellOfLens(arguments, setup.options.lens.given, slam);
  if (const std::string reason = otherWorldReason(setup.options, slam.pieces()); !reason.empty()) {
    std::fprintf(stderr, "waymark: warning: %s\n", reason.c_str());
  }
  tellOfContradictions(setup.options.markers, slam.pieces());
  if (setup.output) {
    const auto statistics = [&](const std::string& why) {
      return record.statistics(slam, timer, setup.input->droppedLate(), why, verdict);
    };
    note(writeResults(slam, statistics, *incomplete, record, setup));
    if (!arguments.quiet && !setup.output->earlier().empty()) {
      std::fprintf(stderr, "the results that were in %s are in %s now\n", arguments.out.c_str(),
                   setup.output->earlier().c_str());
    }
  }
  const bool rejected = verdict.grade == diagnosis::Verdict::Grade::kNone;
  if (!arguments.quiet) printSummary(record, slam, timer);
  if (!arguments.quiet || rejected) {
    std::fputs(diagnosis::formatVerdict(verdict).c_str(), arguments.quiet ? stderr : stdout);
  }
  if (!complete) return kIncomplete;
  return rejected ? kNoPose : kDone;
}

void addCalibrationFit(CLI::App& command, slam::CalibrationFit& fit) {
  using slam::CalibrationFit;
  const std::map<std::string, CalibrationFit> names = {{"exact", CalibrationFit::kExact},
                                                       {"scale", CalibrationFit::kScale},
                                                       {"crop", CalibrationFit::kCrop}};
  command
      .add_option(
          "--calibration-fit", fit,
          "Images of another size than the calibration's: exact (refuse them, the default), "
          "scale (the same view at another scale) or crop (its middle)")
      ->transform(CLI::Transformer(names))
      ->option_text("exact|scale|crop");
}

}  // namespace

void addRunCommand(CLI::App& app, int* exit_code) {
  CLI::App* command = app.add_subcommand("run", "Run the SLAM over a recording or a camera");
  const auto arguments = std::make_shared<RunArguments>();
  command
      ->add_option("source", arguments->source,
                   "A video file, a directory of images (in the order of their names; frames.txt "
                   "with lines FILE SECONDS, or --fps, for times), an event log that the daemon "
                   "recorded, a detections.csv, or a camera "
                   "(v4l2:/dev/video0), until interrupted")
      ->required();
  command->add_option("--calibration", arguments->calibration,
                      "Camera: YAML of OpenCV, ROS (camera_info) or Kalibr (FILE#cam1 for one of "
                      "several). An event log of the daemon brings its own. Without one the lens "
                      "is learned from the markers");
  addCalibrationFit(*command, arguments->calibration_fit);
  addMarkerArguments(*command, arguments->markers);
  command->add_option(
      "--out", arguments->out,
      "Directory for trajectory.tum, trajectory_final.tum, poses.csv, poses_final.csv, "
      "map.json, map.svg and stats.json");
  CLI::Option* map_in =
      command->add_option("--map-in", arguments->map_in, "Go on with this map.json");
  CLI::Option* localize_only =
      command
          ->add_flag("--localize-only", arguments->localize_only,
                     "Leave the map of --map-in as it is, bit for bit; any camera will do")
          ->needs(map_in);
  command->add_option("--save-detections", arguments->save_detections,
                      "Write the corners found in each frame into this detections.csv, and a "
                      "frames.csv beside it; both can be run again");
  command
      ->add_option("--fps", arguments->fps,
                   "Frame rate, instead of the recording's own or the camera's fastest, Hz")
      ->check(frameRate());
  command
      ->add_option(
          "--natural", arguments->natural,
          "Natural markers (pictures whose print is known): a file as `waymark natural add` "
          "makes it")
      ->check(CLI::ExistingFile);
  CLI::Option* no_global =
      command->add_flag("--no-global", arguments->no_global,
                        "Leave the map as it was live: no optimization at the end");
  command
      ->add_flag("--refine-intrinsics", arguments->refine_intrinsics,
                 "Let the optimization at the end improve the calibration too, and write it as "
                 "calib.yml")
      ->excludes(no_global)
      ->excludes(localize_only);
  command->add_flag("--realtime", arguments->realtime,
                    "Play at the recording's rate and drop late frames, as live; times then count "
                    "from the first frame");
  command->add_flag("--quiet", arguments->quiet, "Say nothing but errors");
  command->callback([arguments, exit_code] {
    const Result<ExitCode> result = run(*arguments);
    if (!result) std::fprintf(stderr, "waymark: %s\n", result.error().message.c_str());
    *exit_code = result ? result.value() : kBadInput;
  });
}

}  // namespace waymark::tools
