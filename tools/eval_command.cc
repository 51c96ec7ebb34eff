#include "tools/eval_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/decimal_seconds.h"
#include "io/calibrations/calibration_file.h"
#include "io/maps/map_file.h"
#include "io/maps/map_picture.h"
#include "io/maps/visible_markers.h"
#include "io/recorded_detections.h"
#include "io/text/number_text.h"
#include "io/trajectory.h"
#include "tools/eval_report.h"
#include "tools/evaluation/accuracy_limit.h"
#include "tools/evaluation/evaluation.h"
#include "tools/exit_code.h"
#include "tools/number_arguments.h"

namespace waymark::tools {
namespace {

struct EvalArguments {
  std::string truth;
  std::string estimate;
  std::string truth_map;
  std::string map;
  std::string visible;
  std::string limit;  // detections
  std::string calibration;
  std::size_t limit_frames = LimitOptions{}.frames;
  std::vector<int> ignored_ids;
  std::vector<std::string> skipped;  // BEGIN:END, as typed
  std::string picture;
  double tolerance_ms = 2.0;
  bool json = false;
};

struct Window {
  std::int64_t begin_ns = 0;
  std::int64_t end_ns = 0;
};

// What is in the files, without what is to be ignored.
struct Inputs {
  io::Trajectory truth;
  io::Trajectory estimate;
  std::vector<io::MarkerCorners> truth_map;
  std::vector<io::MarkerCorners> map;
  std::vector<io::VisibleMarker> visible;
};

Status checkArguments(const EvalArguments& a) {
  const auto needs = [](const char* what, bool with, const char* other) -> Status {
    if (with) return success();
    return Error{std::string(what) + " needs " + other};
  };
  if (a.estimate.empty() && a.map.empty() && a.limit.empty()) {
    return Error{"eval: nothing to measure: --estimate, --map or --limit is required"};
  }
  Status status = success();
  if (!a.estimate.empty()) status = needs("--estimate", !a.truth.empty(), "--truth");
  // A map without its truth is there for the picture or for what is in view.
  const bool map_is_used = !a.picture.empty() || !a.visible.empty();
  if (status && !a.map.empty() && !map_is_used) {
    status = needs("--map", !a.truth_map.empty(), "--truth-map");
  }
  if (status && !a.truth_map.empty()) {
    status = needs("--truth-map", !a.map.empty() || !a.limit.empty(), "--map or --limit");
  }
  if (status && !a.visible.empty()) {
    status = needs("--visible", !a.map.empty() && !a.estimate.empty(), "--map and --estimate");
  }
  if (status && !a.limit.empty()) {
    status = needs("--limit", !a.truth.empty() && !a.truth_map.empty() && !a.calibration.empty(),
                   "--truth, --truth-map and --calibration");
  }
  if (status && !a.picture.empty()) status = needs("--picture", !a.estimate.empty(), "--estimate");
  return status;
}

Result<std::vector<Window>> parseWindows(const std::vector<std::string>& texts) {
  std::vector<Window> windows;
  for (const std::string& text : texts) {
    const std::vector<std::string_view> ends = io::split(text, ':');
    const auto begin = ends.size() == 2 ? parseSeconds(ends[0]) : std::nullopt;
    const auto end = ends.size() == 2 ? parseSeconds(ends[1]) : std::nullopt;
    if (!begin || !end || *begin >= *end) {
      return Error{"--skip: '" + text + "' is not of the form BEGIN:END, in seconds"};
    }
    windows.push_back({*begin, *end});
  }
  return windows;
}

// Reads into *target where a file is named.
template <typename T>
Status readInto(const std::string& file,
                Result<std::vector<T>> (*read)(const std::filesystem::path&),
                std::vector<T>* target) {
  if (file.empty()) return success();
  Result<std::vector<T>> content = read(file);
  if (!content) return content.error();
  *target = std::move(content).value();
  return success();
}

Result<Inputs> readInputs(const EvalArguments& a) {
  const Result<std::vector<Window>> windows = parseWindows(a.skipped);
  if (!windows) return windows.error();
  Inputs inputs;
  Status status = readInto(a.truth, io::readTrajectory, &inputs.truth);
  if (status) status = readInto(a.estimate, io::readTrajectory, &inputs.estimate);
  if (status) status = readInto(a.map, io::readMarkerCorners, &inputs.map);
  if (status) status = readInto(a.truth_map, io::readMarkerCorners, &inputs.truth_map);
  if (status) status = readInto(a.visible, io::readVisibleMarkers, &inputs.visible);
  if (!status) return status.error();

  const auto skipped = [&](const auto& at) {
    return std::any_of(windows->begin(), windows->end(), [&](const Window& w) {
      return w.begin_ns <= at.time_ns && at.time_ns < w.end_ns;
    });
  };
  std::erase_if(inputs.truth, skipped);
  std::erase_if(inputs.estimate, skipped);
  std::erase_if(inputs.visible, skipped);
  const auto ignored = [&](const auto& marker) {
    return std::count(a.ignored_ids.begin(), a.ignored_ids.end(), marker.id) != 0;
  };
  std::erase_if(inputs.map, ignored);
  std::erase_if(inputs.truth_map, ignored);
  std::erase_if(inputs.visible, ignored);
  return inputs;
}

Result<AccuracyLimit> limitOf(const EvalArguments& a, const Inputs& inputs,
                              const TrajectoryOptions& trajectory_options) {
  const Result<slam::Calibration> calibration = io::readCalibration(a.calibration);
  if (!calibration) return calibration.error();
  const slam::CameraModel camera(*calibration);
  const Result<io::RecordedDetections> recorded = io::readRecordedDetections(a.limit, camera);
  if (!recorded) return recorded.error();
  LimitOptions options;
  options.frames = a.limit_frames;
  Result<AccuracyLimit> limit = accuracyLimit(recorded->frames, camera, inputs.truth,
                                              inputs.truth_map, trajectory_options, options);
  if (!limit) return Error{a.limit + ": " + limit.error().message};
  return limit;
}

// Everything in the truth's world, in which up and down usually mean something.
Status drawPicture(const std::string& file, Inputs inputs, const TrajectoryErrors& errors) {
  const slam::Transform& T = errors.T_truth_est;
  for (io::StampedPose& pose : inputs.estimate) pose.T_w_c = T * pose.T_w_c;
  for (io::MarkerCorners& marker : inputs.map) {
    for (Eigen::Vector3d& corner : marker.corners) corner = T * corner;
  }
  const std::string ate = io::fixed(1000.0 * errors.ate_m.mean, 2);
  return io::writeMapPicture(file,
                             {.title = "Map and trajectory against the truth: ATE " + ate + " mm",
                              .pieces = {{.markers = std::move(inputs.map),
                                          .estimate = std::move(inputs.estimate),
                                          .truth = std::move(inputs.truth)}},
                              .z_is_up = true});
}

Result<Evaluation> evaluate(const EvalArguments& a) {
  if (Status status = checkArguments(a); !status) return status.error();
  const Result<Inputs> inputs = readInputs(a);
  if (!inputs) return inputs.error();
  TrajectoryOptions options;
  options.tolerance_ns = std::llround(1e6 * a.tolerance_ms);
  Evaluation evaluation;
  if (!a.estimate.empty()) {
    const auto trajectory = compareTrajectories(inputs->truth, inputs->estimate, options);
    if (!trajectory) return Error{a.estimate + ": " + trajectory.error().message};
    evaluation.trajectory = *trajectory;
  }
  if (!a.visible.empty()) {
    ViewCoverageOptions coverage_options;
    coverage_options.tolerance_ns = options.tolerance_ns;
    evaluation.coverage =
        viewCoverage(inputs->visible, inputs->map, inputs->estimate, coverage_options);
  }
  if (!a.truth_map.empty() && !a.map.empty()) {
    const Result<MapErrors> map = compareMaps(inputs->truth_map, inputs->map);
    if (!map) return Error{a.map + ": " + map.error().message};
    evaluation.map = *map;
  }
  if (!a.limit.empty()) {
    const Result<AccuracyLimit> limit = limitOf(a, *inputs, options);
    if (!limit) return limit.error();
    evaluation.limit = *limit;
  }
  if (!a.picture.empty()) {
    const Status drawn = drawPicture(a.picture, *inputs, *evaluation.trajectory);
    if (!drawn) return drawn.error();
  }
  return evaluation;
}

void addOptions(CLI::App* command, EvalArguments* a) {
  command->add_option("--truth", a->truth, "True trajectory, TUM format");
  command->add_option("--estimate", a->estimate, "Trajectory to measure, TUM format");
  command->add_option("--truth-map", a->truth_map, "True marker corners, gt_map.json or map.json");
  command->add_option("--map", a->map, "Map to measure, map.json");
  command->add_option("--visible", a->visible,
                      "What is in view, gt_visible.csv: count the frames with a pose among those "
                      "that have a marker of the map, 20 pixels or more, in view");
  command->add_option("--limit", a->limit,
                      "Corners, detections.csv: adjust all poses from the truth on and measure "
                      "what that gives, the best that any map of these corners could be");
  command->add_option("--calibration", a->calibration, "Camera of --limit, OpenCV YAML");
  command
      ->add_option("--limit-frames", a->limit_frames, "Frames that --limit adjusts, evenly spread")
      ->capture_default_str()
      ->check(count());
  command->add_option("--ignore", a->ignored_ids, "Marker ids to leave out of every measure");
  command->add_option("--skip", a->skipped,
                      "Seconds to leave out of the trajectories, BEGIN:END; may be repeated");
  command->add_option("--picture", a->picture, "Draw map and trajectories into this SVG file");
  command
      ->add_option("--tolerance", a->tolerance_ms,
                   "Poses of one frame are at most this far apart in time, ms")
      ->capture_default_str()
      ->check(numberFrom(0.0, 1e9));
  command->add_flag("--json", a->json, "Print JSON");
}

}  // namespace

void addEvalCommand(CLI::App& app, int* exit_code) {
  CLI::App* command =
      app.add_subcommand("eval", "Measure a trajectory and a map against the truth");
  const auto arguments = std::make_shared<EvalArguments>();
  addOptions(command, arguments.get());
  command->callback([arguments, exit_code] {
    const Result<Evaluation> evaluation = evaluate(*arguments);
    if (!evaluation) {
      std::fprintf(stderr, "waymark: %s\n", evaluation.error().message.c_str());
      *exit_code = kBadInput;
      return;
    }
    const std::string text = arguments->json ? jsonText(*evaluation) : plainText(*evaluation);
    std::fputs(text.c_str(), stdout);
  });
}

}  // namespace waymark::tools
