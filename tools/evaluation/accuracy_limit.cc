#include "tools/evaluation/accuracy_limit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "slam/geometry/align_points.h"
#include "slam/geometry/robust.h"

namespace waymark::tools {
namespace {

struct TrueMarker {
  double size_m = 0.0;
  slam::Transform T_w_m;
};

struct View {
  const slam::MarkerDetection* detection = nullptr;
  double worst_px = 0.0;     // the farthest corner from its true place
  double squared_px2 = 0.0;  // sum over the corners
};

struct Frame {
  std::int64_t time_ns = 0;
  slam::Transform T_w_c;  // the truth
  std::vector<View> views;
};

std::map<int, TrueMarker> trueMarkers(std::span<const io::MarkerCorners> layout) {
  std::map<int, TrueMarker> markers;
  for (const io::MarkerCorners& marker : layout) {
    const auto own = slam::markerCorners(marker.size_m);
    markers[marker.id] = {marker.size_m, slam::alignPoints(own, marker.corners)};
  }
  return markers;
}

// Infinitely far off when a true corner is not in front of the lens.
View compare(const slam::MarkerDetection& detection, const slam::CameraModel& camera,
             const slam::Transform& T_w_c, const TrueMarker& marker) {
  View view{&detection, 0.0, 0.0};
  const auto corners = slam::markerCorners(marker.size_m);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto pixel = camera.project(T_w_c.inverse() * (marker.T_w_m * corners[k]));
    const double squared = pixel ? (detection.pixels[k] - *pixel).squaredNorm()
                                 : std::numeric_limits<double>::infinity();
    view.worst_px = std::max(view.worst_px, std::sqrt(squared));
    view.squared_px2 += squared;
  }
  return view;
}

// The frames with a true pose, and what they see of the true markers.
std::vector<Frame> framesWithTruth(std::span<const io::RecordedFrame> recorded,
                                   const slam::CameraModel& camera, io::Trajectory truth,
                                   const std::map<int, TrueMarker>& markers,
                                   std::int64_t tolerance_ns) {
  std::vector<Frame> frames;
  sortByTime(&truth);
  for (const io::RecordedFrame& frame : recorded) {
    const io::StampedPose* pose = nearestPose(truth, frame.time_ns, tolerance_ns);
    if (pose == nullptr) continue;
    frames.push_back({frame.time_ns, pose->T_w_c, {}});
    for (const slam::MarkerDetection& detection : frame.detections) {
      const auto marker = markers.find(detection.id);
      if (marker == markers.end()) continue;
      frames.back().views.push_back(compare(detection, camera, pose->T_w_c, marker->second));
    }
  }
  return frames;
}

// Removes the gross views, then the frames without a view.
void removeOutliers(const LimitOptions& options, std::vector<Frame>* frames, AccuracyLimit* limit) {
  std::vector<double> distances_px;
  for (const Frame& frame : *frames) {
    for (const View& view : frame.views) distances_px.push_back(view.worst_px);
  }
  if (distances_px.empty()) return;
  const double gate_px =
      std::max(options.gross_px, options.gross_per_median * slam::median(distances_px));
  double squared_px2 = 0.0;
  std::size_t kept = 0;
  for (Frame& frame : *frames) {
    limit->outlier_views +=
        std::erase_if(frame.views, [&](const View& view) { return !(view.worst_px <= gate_px); });
    for (const View& view : frame.views) squared_px2 += view.squared_px2;
    kept += frame.views.size();
  }
  std::erase_if(*frames, [](const Frame& frame) { return frame.views.empty(); });
  if (kept > 0) limit->corner_rms_px = std::sqrt(squared_px2 / (8.0 * static_cast<double>(kept)));
}

// `count` of them, the first and the last included.
std::vector<Frame> evenlySpread(const std::vector<Frame>& frames, std::size_t count) {
  if (frames.size() <= count) return frames;
  if (count == 1) return {frames.front()};
  std::vector<Frame> chosen;
  for (std::size_t i = 0; i < count; ++i) {
    chosen.push_back(frames[i * (frames.size() - 1) / (count - 1)]);
  }
  return chosen;
}

struct Problem {
  slam::BundleProblem bundle;
  std::vector<int> marker_ids;  // as bundle.markers
};

Problem problemOf(const std::vector<Frame>& frames, const std::map<int, TrueMarker>& markers) {
  Problem problem;
  std::map<int, int> index;
  for (const Frame& frame : frames) {
    const int camera = static_cast<int>(problem.bundle.cameras.size());
    // The first camera holds the gauge; the alignment to the truth takes it away again.
    problem.bundle.cameras.push_back({frame.T_w_c, camera == 0});
    for (const View& view : frame.views) {
      const int id = view.detection->id;
      const auto [entry, is_new] =
          index.try_emplace(id, static_cast<int>(problem.bundle.markers.size()));
      if (is_new) {
        problem.bundle.markers.push_back({markers.at(id).T_w_m, false});
        problem.bundle.marker_sizes_m.push_back(markers.at(id).size_m);
        problem.marker_ids.push_back(id);
      }
      problem.bundle.observations.push_back({camera, entry->second, view.detection});
    }
  }
  return problem;
}

std::vector<io::MarkerCorners> layoutOf(const Problem& problem) {
  std::vector<io::MarkerCorners> layout;
  for (std::size_t m = 0; m < problem.marker_ids.size(); ++m) {
    const double size_m = problem.bundle.marker_sizes_m[m];
    io::MarkerCorners marker{problem.marker_ids[m], size_m, slam::markerCorners(size_m)};
    for (Eigen::Vector3d& corner : marker.corners) corner = problem.bundle.markers[m].T * corner;
    layout.push_back(marker);
  }
  return layout;
}

}  // namespace

Result<AccuracyLimit> accuracyLimit(std::span<const io::RecordedFrame> recorded,
                                    const slam::CameraModel& camera, const io::Trajectory& truth,
                                    std::span<const io::MarkerCorners> truth_map,
                                    const TrajectoryOptions& trajectory_options,
                                    const LimitOptions& options) {
  AccuracyLimit limit;
  const std::map<int, TrueMarker> markers = trueMarkers(truth_map);
  std::vector<Frame> frames =
      framesWithTruth(recorded, camera, truth, markers, trajectory_options.tolerance_ns);
  if (frames.empty()) return Error{"no frame has the time of a true pose"};
  removeOutliers(options, &frames, &limit);
  frames = evenlySpread(frames, options.frames);
  if (frames.empty()) return Error{"no frame sees a marker where the truth has it"};

  Problem problem = problemOf(frames, markers);
  const slam::BundleSummary summary = slam::adjustBundle(&problem.bundle, options.bundle);
  if (summary.failed) return Error{"the adjustment from the truth has no solution"};
  limit.frames = frames.size();
  limit.views = problem.bundle.observations.size();

  io::Trajectory optimum;
  for (std::size_t c = 0; c < frames.size(); ++c) {
    optimum.push_back({frames[c].time_ns, problem.bundle.cameras[c].T});
  }
  const auto trajectory = compareTrajectories(truth, optimum, trajectory_options);
  if (!trajectory) return trajectory.error();
  limit.trajectory = *trajectory;
  const auto map = compareMaps(truth_map, layoutOf(problem));
  if (!map) return map.error();
  limit.map = *map;
  return limit;
}

}  // namespace waymark::tools
