#include "tools/run_command.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <opencv2/core.hpp>

#include "daemon/control/stop_signal.h"
#include "io/calibrations/calibration_file.h"
#include "io/frame_poses.h"
#include "io/maps/map_file.h"
#include "io/maps/map_picture.h"
#include "io/maps/old_map.h"
#include "io/pictures/natural_marker_set.h"
#include "io/recorded_detections.h"
#include "io/settings/slam_settings.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "slam/final_map.h"
#include "slam/map/world_reference.h"
#include "slam/slam.h"
#include "tools/diagnosis/grey_image.h"
#include "tools/diagnosis/run_verdict.h"
#include "tools/exit_code.h"
#include "tools/marker_arguments.h"
#include "tools/natural/delayed_relocalizer.h"
#include "tools/natural/recorded_late_results.h"
#include "tools/number_arguments.h"
#include "tools/progress_bar.h"
#include "tools/recorded_inputs.h"
#include "tools/run_diagnosis.h"
#include "tools/run_input.h"
#include "tools/run_record.h"
#include "tools/stage_timer.h"

namespace waymark::tools {
namespace {

struct RunArguments {
  std::string source;
  std::string calibration;
  slam::CalibrationFit calibration_fit = slam::CalibrationFit::kExact;
  MarkerArguments markers;
  std::string out;
  std::string map_in;
  bool localize_only = false;
  bool refine_intrinsics = false;
  std::string save_detections;
  std::optional<double> fps;
  std::string natural;
  bool no_global = false;
  bool realtime = false;
  bool quiet = false;
};

// Everything a run needs, checked.
struct RunSetup {
  slam::CameraModel camera;
  slam::Dictionary dictionary;
  slam::Options options;
  std::unique_ptr<RunInput> input;
  std::string calibration_change;  // what was done to the calibration; usually nothing
  std::string calibration_name;    // of the lens as it was used in the end
  std::optional<io::OutputDirectory> output;
  std::optional<io::OutputDirectory> detections;  // the directory of --save-detections
  std::optional<io::OldMap> old_map;
  std::unique_ptr<LateResults> late;  // null without natural markers
};

// --map-in, or the one that the daemon began with when it made the recording.
Result<std::optional<io::OldMap>> oldMap(const RunArguments& arguments,
                                         const io::SlamSettings& settings,
                                         const std::optional<capture::RecordedFile>& recorded,
                                         const slam::Calibration& camera) {
  if (arguments.map_in.empty() && !recorded) return std::optional<io::OldMap>();
  const io::OldMapUse use{.dictionary = settings.dictionary,
                          .markers = settings.options.markers,
                          .camera = camera,
                          .localize_only = settings.map.localize_only};
  Result<io::OldMap> old = arguments.map_in.empty()
                               ? io::parseOldMap(recorded->content, recorded->name, use)
                               : io::readOldMap(arguments.map_in, use);
  if (!old) return old.error();
  return std::optional(std::move(old).value());
}

// frames.csv goes beside the detections and belongs to all of them in that directory: one that came
// with other detections stays.
Result<std::optional<io::OutputDirectory>> openDetections(const std::string& file) {
  if (file.empty()) return std::optional<io::OutputDirectory>();
  const std::filesystem::path path(file);
  if (path.extension() != ".csv" || path.filename() == "frames.csv") {
    return Error{"--save-detections: '" + file + "' must be a name like detections.csv"};
  }
  const std::filesystem::path directory = path.has_parent_path() ? path.parent_path() : ".";
  std::error_code error;
  if (std::filesystem::exists(directory / "frames.csv", error) &&
      !std::filesystem::exists(path, error)) {
    return Error{(directory / "frames.csv").string() +
                 ": exists already and belongs to other detections; choose another directory"};
  }
  Result<io::OutputDirectory> opened = io::OutputDirectory::open(directory);
  if (!opened) return opened.error();
  return std::optional<io::OutputDirectory>(std::move(opened).value());
}

// Does the command line say what to look for, or where to begin?
bool saysOtherwise(const RunArguments& arguments) {
  const MarkerArguments& markers = arguments.markers;
  return !markers.config.empty() || !markers.dictionary.empty() || !markers.marker_size.empty() ||
         !arguments.map_in.empty();
}

// Empty where nobody has given one.
Result<std::optional<slam::Calibration>> calibrationOf(const RunArguments& arguments,
                                                       const RecordedInputs& recorded) {
  if (arguments.calibration.empty()) return recorded.calibration;
  const Result<slam::Calibration> read = io::readCalibration(arguments.calibration);
  if (!read) return read.error();
  return std::optional(*read);
}

// A camera that nobody has calibrated is learned from the markers.
Status takeLens(const OpenedInput& opened, std::optional<double> fov_deg, slam::Options* options) {
  if (opened.lens_given) return success();
  slam::LensOptions& lens = options->lens;
  if (!lens.learn) return Error{"--calibration: required where camera.learn is off"};
  lens.takeForGuess(fov_deg.has_value());
  return success();
}

// What the lens is written as: a file that was given stays what it was.
std::string calibrationName(const RunArguments& arguments) {
  std::error_code error;
  const auto beside = std::filesystem::path(arguments.out) / "calib.yml";
  const bool is_given = !arguments.calibration.empty() &&
                        std::filesystem::equivalent(beside, arguments.calibration, error);
  return is_given ? "calib_learned.yml" : "calib.yml";
}

// The natural markers of --natural: the SLAM is told of them, and somebody looks for them.
Status addPictures(const std::string& file, RunSetup* setup) {
  if (file.empty()) return success();
  if (!setup->input->hasImages()) {
    return Error{"--natural: recorded detections have no images to look for pictures in"};
  }
  if (!setup->options.lens.given) {
    return Error{"--natural: needs --calibration: pictures are looked for through a known lens"};
  }
  if (setup->input->unorderedImages() || !setup->options.natural.enabled) {
    return Error{"--natural: needs a sequence of images, and slam.natural.enabled"};
  }
  Result<io::NaturalMarkerSet> set = io::readNaturalMarkers(file);
  if (!set) return set.error();
  for (const std::string& note : set->notes) std::fprintf(stderr, "waymark: %s\n", note.c_str());
  setup->options.natural.prints = io::printsOf(*set);
  if (const std::string reason = setup->options.invalidReason(); !reason.empty()) {
    return Error{file + ": " + reason};
  }
  setup->late =
      std::make_unique<DelayedRelocalizer>(io::picturesOf(std::move(*set)), setup->camera);
  return success();
}

// Those of a recording: they have been looked for.
Status addRecordedPictures(const std::string& source, std::vector<slam::PicturePrint> prints,
                           RunSetup* setup) {
  if (prints.empty()) return success();
  setup->options.natural.prints = std::move(prints);
  if (const std::string reason = setup->options.invalidReason(); !reason.empty()) {
    return Error{source + ": " + reason};
  }
  auto recorded = RecordedLateResults::read(source);
  if (!recorded) return recorded.error();
  setup->late = std::make_unique<RecordedLateResults>(std::move(*recorded));
  return success();
}

// trajectory_2.tum and the like: an earlier run may have had more pieces.
bool isTrajectory(const std::string& name) {
  return name.starts_with("trajectory") && name.ends_with(".tum");
}

Result<RunSetup> prepare(const RunArguments& arguments) {
  Result<RecordedInputs> recorded = recordedInputs(arguments.source);
  if (!recorded) return recorded.error();
  const bool as_recorded = recorded->settings && !saysOtherwise(arguments);
  Result<io::SlamSettings> settings = as_recorded
                                          ? slamSettings(arguments.markers, recorded->settings)
                                          : slamSettings(arguments.markers);
  if (!settings) return settings.error();
  // The configuration's own files are not there any more, or are not what they were.
  settings->map.localize_only =
      arguments.localize_only || (as_recorded && settings->map.localize_only);
  if (!as_recorded) recorded->map.reset();
  const Result<std::optional<slam::Calibration>> calibration = calibrationOf(arguments, *recorded);
  if (!calibration) return calibration.error();
  Result<OpenedInput> opened = openRunInput({.source = arguments.source,
                                             .calibration = arguments.calibration,
                                             .calibration_fit = arguments.calibration_fit,
                                             .fps = arguments.fps,
                                             .realtime = arguments.realtime,
                                             .fov_deg = settings->fov_deg},
                                            *calibration);
  if (!opened) return opened.error();
  const slam::FittedCalibration& fitted = opened->fitted;
  const Status lens = takeLens(*opened, settings->fov_deg, &settings->options);
  if (!lens) return lens.error();
  Result<std::optional<io::OldMap>> old_map =
      oldMap(arguments, *settings, recorded->map, fitted.calibration);
  if (!old_map) return old_map.error();
  Result<std::optional<io::OutputDirectory>> detections = openDetections(arguments.save_detections);
  if (!detections) return detections.error();
  std::optional<io::OutputDirectory> output;
  if (!arguments.out.empty()) {
    Result<io::OutputDirectory> directory = io::OutputDirectory::open(arguments.out);
    if (!directory) return directory.error();
    output.emplace(std::move(directory).value());
    output->keepEarlierIn("previous", isTrajectory);
  }
  RunSetup setup{slam::CameraModel(fitted.calibration),
                 *slam::Dictionary::byName(settings->dictionary),
                 settings->options,
                 std::move(opened->input),
                 fitted.change,
                 calibrationName(arguments),
                 std::move(output),
                 std::move(detections).value(),
                 std::move(old_map).value(),
                 nullptr};
  setup.options.mapping = !settings->map.localize_only;
  if (setup.input->unorderedImages()) setup.options.treatAsUnorderedImages();
  if (setup.old_map) io::agreeOnReadout(&*setup.old_map, &setup.options);
  const bool pictures_as_recorded = as_recorded && arguments.natural.empty() && !arguments.fps;
  const Status added =
      pictures_as_recorded
          ? addRecordedPictures(arguments.source, std::move(recorded->prints), &setup)
          : addPictures(arguments.natural, &setup);
  if (!added) return added.error();
  return setup;
}

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
    record->add((*step)->time_ns, (*step)->result, slam.counters());
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
  if (!markers.anchors.empty() && std::ranges::none_of(markers.anchors, has_pose)) {
    return "none of the anchors was ever placed" + other;
  }
  return {};
}

// A map that was only localized in stays what it was, byte for byte.
std::string mapText(const slam::Slam& slam, const slam::Map& main_piece, const RunSetup& setup) {
  if (!setup.options.mapping) return setup.old_map->text;
  const std::optional<io::FieldSize> field =
      setup.old_map ? setup.old_map->file.field : std::nullopt;
  std::vector<const slam::Map*> others = slam.pieces();
  std::erase(others, &main_piece);
  return io::formatMap(main_piece, slam.camera().calibration(), slam.readout_s(), field, others);
}

// The piece of the map that files of one world are of: the one with an anchor, or else the one with
// the most frames.
const slam::Map& mainPiece(const slam::Slam& slam, const slam::MarkerOptions& markers,
                           const std::map<int, io::Trajectory>& trajectories) {
  const auto frames = [&](const slam::Map* map) {
    const auto found = trajectories.find(map->piece);
    return std::pair(!slam::firstKeyframeIsWorld(*map, markers),
                     found == trajectories.end() ? std::size_t{0} : found->second.size());
  };
  const std::vector<const slam::Map*> pieces = slam.pieces();
  return **std::ranges::max_element(pieces, {}, frames);  // the oldest of several such
}

// NAME.tum of the main piece, and NAME_PIECE.tum of each other one.
void addTrajectories(const std::string& name, int main_piece,
                     std::map<int, io::Trajectory> trajectories, io::OutputDirectory* output) {
  output->add(name + ".tum", io::formatTrajectory(trajectories[main_piece]));
  trajectories.erase(main_piece);
  for (const auto& [piece, trajectory] : trajectories) {
    output->add(name + "_" + std::to_string(piece) + ".tum", io::formatTrajectory(trajectory));
  }
}

// `statistics` makes stats.json, given why it is incomplete. Where the disk is full, what fits.
Status writeOutputs(const slam::Slam& slam,
                    const std::function<std::string(const std::string&)>& statistics,
                    const std::string& incomplete, const RunRecord& record, RunSetup& setup) {
  io::OutputDirectory& output = *setup.output;
  const auto final_poses = record.finalPoses(slam, setup.input->unorderedImages());
  auto final_trajectories = io::trajectoriesOf(final_poses);
  const slam::Map& map = mainPiece(slam, setup.options.markers, final_trajectories);
  output.add("stats.json", statistics(incomplete));
  const auto live_poses = record.livePoses();
  addTrajectories("trajectory", map.piece, io::trajectoriesOf(live_poses), &output);
  output.add("poses.csv", io::formatFramePoses(live_poses));
  output.add("map.json", mapText(slam, map, setup));
  addTrajectories("trajectory_final", map.piece, final_trajectories, &output);
  output.add("poses_final.csv", io::formatFramePoses(final_poses));
  output.add(setup.calibration_name, io::formatCalibration(slam.camera().calibration()));
  output.add("map.svg", io::formatMapPicture({.title = setup.input->description(),
                                              .markers = io::posedMarkerCorners(map),
                                              .estimate = final_trajectories[map.piece],
                                              .truth = {},
                                              .z_is_up = false,
                                              .photographs = setup.input->unorderedImages()}));
  Status written = output.commit();
  if (written) return written;
  output.add("stats.json", statistics(written.error().message));
  std::string message = written.error().message + "; missing:";
  for (const std::string& name : output.commitWhatFits()) message += " " + name;
  return Error{message};
}

Status writeDetections(const std::string& file, const RunRecord& record,
                       const slam::CameraModel& camera, io::OutputDirectory& directory) {
  const std::vector<io::RecordedFrame> frames = record.recordedFrames();
  directory.add(std::filesystem::path(file).filename(),
                io::formatRecordedDetections(frames, camera));
  directory.add("frames.csv", io::formatFrameTimes(frames));
  return directory.commit();
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

// A calibration that the markers contradict.
void tellOfLens(const RunArguments& arguments, const slam::Slam& slam) {
  const slam::LensKnowledge& lens = slam.lens();
  if (arguments.calibration.empty() || lens.state == slam::LensState::kGiven) return;
  std::fprintf(stderr,
               "waymark: %s does not fit these images: RMS %.2f px, %.2f with what was learned, "
               "focal length %.1f instead of %.1f\n",
               arguments.calibration.c_str(), lens.rms_given_px, lens.rms_after_px,
               slam.camera().calibration().fx, lens.given.calibration().fx);
  if (!lens.changedUnderWay()) return;
  std::fprintf(stderr, "waymark: the lens changed under way, %zu times\n", lens.earlier.size());
}

Result<ExitCode> run(const RunArguments& arguments) {
  // The SLAM is one thread; OpenCV's pool would blur its timing and gain nothing.
  cv::setNumThreads(1);
  Result<RunSetup> prepared = prepare(arguments);
  if (!prepared) return prepared.error();
  RunSetup& setup = prepared.value();
  announce(arguments, setup);
  // From here on a signal ends the frames, and what there is by then is written all the same.
  const daemon::StopSignal stop;
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
  const diagnosis::Verdict verdict =
      judgeRun(record, slam, setup.options.markers, setup.dictionary.name(), samples);
  slam::makeFinalMap(record.liveFrames(),
                     {.unordered_images = setup.input->unorderedImages(),
                      .optimize = !arguments.no_global,
                      .refine_intrinsics = arguments.refine_intrinsics},
                     &slam);
  tellOfLens(arguments, slam);
  if (const std::string reason = otherWorldReason(setup.options, slam.pieces()); !reason.empty()) {
    std::fprintf(stderr, "waymark: warning: %s\n", reason.c_str());
  }
  if (setup.output) {
    const auto statistics = [&](const std::string& why) {
      return record.statistics(slam, timer, setup.input->droppedLate(), why, verdict);
    };
    note(writeOutputs(slam, statistics, *incomplete, record, setup));
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
