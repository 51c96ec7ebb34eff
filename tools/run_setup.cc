#include "tools/run_setup.h"

#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "io/calibrations/calibration_file.h"
#include "io/pictures/natural_marker_set.h"
#include "io/settings/settings_file.h"
#include "io/settings/slam_settings.h"
#include "tools/natural/delayed_relocalizer.h"
#include "tools/natural/photograph_relocalizer.h"
#include "tools/natural/recorded_late_results.h"
#include "tools/recorded_inputs.h"

namespace waymark::tools {
namespace {

// --map-in, or the one that the daemon began with when it made the recording.
Result<std::optional<io::OldMap>> oldMap(const RunArguments& arguments,
                                         const io::SlamSettings& settings,
                                         const std::optional<capture::RecordedFile>& recorded,
                                         const OpenedInput& opened) {
  if (arguments.map_in.empty() && !recorded) return std::optional<io::OldMap>();
  const io::OldMapUse use{.dictionary = settings.dictionary,
                          .markers = settings.options.markers,
                          .camera = opened.fitted.calibration,
                          .lens_given = opened.lens_given,
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

// A configuration's natural markers are the daemon's: here they would go unnoticed.
void tellOfUnusedPictures(const RunArguments& arguments) {
  const std::string& config = arguments.markers.config;
  if (config.empty() || !arguments.natural.empty()) return;
  const Result<std::string> text = io::readTextFile(config);
  if (!text) return;
  const io::SettingTexts said = io::settingTexts(*text);
  const bool in_sections = said.contains("natural");
  if (!in_sections && !said.contains("relocalizer.markers")) return;
  std::fprintf(stderr,
               "waymark: warning: %s: %s is not used here; --natural FILE.json gives natural "
               "markers\n",
               config.c_str(), in_sections ? "[[natural]]" : "relocalizer.markers");
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
  // Between photographs nothing is carried.
  const bool photographs = setup->input->unorderedImages();
  if (!photographs && !setup->options.natural.enabled) {
    return Error{"--natural: needs slam.natural.enabled"};
  }
  Result<io::NaturalMarkerSet> set = io::readNaturalMarkers(file);
  if (!set) return set.error();
  for (const std::string& note : set->notes) std::fprintf(stderr, "waymark: %s\n", note.c_str());
  if (const std::string alike = io::alikeNote(*set, file); !alike.empty()) {
    std::fprintf(stderr, "waymark: warning: %s\n", alike.c_str());
  }
  setup->options.natural.prints = io::printsOf(*set);
  if (const std::string reason = setup->options.invalidReason(); !reason.empty()) {
    return Error{file + ": " + reason};
  }
  std::vector<slam::PosedNaturalMarker> pictures = io::picturesOf(std::move(*set));
  if (photographs) {
    setup->late = std::make_unique<PhotographRelocalizer>(std::move(pictures));
  } else {
    setup->late = std::make_unique<DelayedRelocalizer>(std::move(pictures));
  }
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

}  // namespace

Result<RunSetup> prepareRun(const RunArguments& arguments) {
  Result<RecordedInputs> recorded = recordedInputs(arguments.source);
  if (!recorded) return recorded.error();
  const bool as_recorded = recorded->settings && !saysOtherwise(arguments);
  Result<io::SlamSettings> settings = as_recorded
                                          ? slamSettings(arguments.markers, recorded->settings)
                                          : slamSettings(arguments.markers);
  if (!settings) return settings.error();
  tellOfUnusedPictures(arguments);
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
  const Status lens = takeLens(*opened, settings->fov_deg, &settings->options);
  if (!lens) return lens.error();
  Result<std::optional<io::OldMap>> old_map = oldMap(arguments, *settings, recorded->map, *opened);
  if (!old_map) return old_map.error();
  slam::Calibration camera = opened->fitted.calibration;
  if (*old_map && (*old_map)->lens) {
    camera = *(*old_map)->lens;
    settings->options.lens.given = opened->lens_given || !settings->map.localize_only;
  }
  Result<std::optional<io::OutputDirectory>> detections = openDetections(arguments.save_detections);
  if (!detections) return detections.error();
  std::optional<io::OutputDirectory> output;
  if (!arguments.out.empty()) {
    Result<io::OutputDirectory> directory = io::OutputDirectory::open(arguments.out);
    if (!directory) return directory.error();
    output.emplace(std::move(directory).value());
    output->keepEarlierIn("previous", isTrajectory);
  }
  RunSetup setup{slam::CameraModel(camera),  *slam::Dictionary::byName(settings->dictionary),
                 settings->options,          std::move(opened->input),
                 opened->fitted.change,      calibrationName(arguments),
                 std::move(output),          std::move(detections).value(),
                 std::move(old_map).value(), nullptr};
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

}  // namespace waymark::tools
