#include "slam/camera/lens_start.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "slam/camera/lens_model.h"
#include "slam/camera/undistort_map.h"
#include "slam/marker_pose/square_pose.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

CameraModel withFocal(const CameraModel& camera, double share, DistortionModel model) {
  Calibration c = camera.calibration();
  c.fx *= share;
  c.fy *= share;
  c.model = model;
  return CameraModel(c);
}

}  // namespace

std::string LensStartOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(likely_focal) && isPositive(focal_share) && isPositive(said_focal_share),
       "the focal length of an unknown camera must be positive, and its sigma, too"},
      {isPositive(enough_share), "the sigma of a focal length to begin with must be positive"},
      {frames >= 1 && views >= 1, "a lens to begin with needs at least 1 view"},
  });
}

CameraModel guessedCamera(int width, int height, std::optional<double> fov_deg,
                          const LensStartOptions& options) {
  Calibration c;
  c.width = width;
  c.height = height;
  constexpr double kHalf_rad = 0.5 * std::numbers::pi / 180.0;
  c.fx = c.fy =
      fov_deg ? 0.5 * width / std::tan(kHalf_rad * *fov_deg) : options.likely_focal * width;
  c.cx = 0.5 * (width - 1);
  c.cy = 0.5 * (height - 1);
  return CameraModel(c);
}

std::optional<StartingLens> LensStart::process(std::span<const MarkerDetection> detections) {
  if (detections.empty()) return std::nullopt;
  ++frames_;
  for (const MarkerDetection& detection : detections) {
    views_.push_back({detection, markers_.sizeOf(detection.id)});
  }
  while (static_cast<int>(views_.size()) > options_.views) views_.pop_front();
  const std::optional<StartingLens> best = bestLens();
  if (!best) {
    if (frames_ < 2 * options_.frames) return std::nullopt;
    return StartingLens{guess_, prior_.covariance(guess_)};
  }
  const bool enough = best->focalShare() <= options_.enough_share;
  return enough || frames_ >= options_.frames ? best : std::nullopt;
}

// Of several to begin with, as each leads to the nearest minimum only; of the two models the
// fisheye has to explain more than chance does, also from where the other one has ended.
std::optional<StartingLens> LensStart::bestLens() const {
  std::optional<StartingLens> best;
  double least = std::numeric_limits<double>::infinity();
  const auto attempt = [&](const CameraModel& from) {
    double cost = 0.0;
    auto found = estimate(from, &cost);
    if (!found || !coversImage(found->camera)) return;
    if (from.calibration().model == DistortionModel::kEquidistant) cost += options_.model_evidence;
    if (!(cost < least)) return;
    best = std::move(found);
    least = cost;
  };
  for (const DistortionModel model : {DistortionModel::kRational, DistortionModel::kEquidistant}) {
    for (const double share : {1.0, 0.6, 1.7}) attempt(withFocal(guess_, share, model));
  }
  if (!best || best->camera.calibration().model == DistortionModel::kRational) return best;
  const CameraModel fisheye = best->camera;
  if (const auto usual = inModel(DistortionModel::kRational, fisheye)) attempt(*usual);
  return best;
}

// Each square is a marker of its own, seen by one camera that does not move.
std::optional<StartingLens> LensStart::estimate(const CameraModel& from, double* cost) const {
  std::vector<MarkerDetection> seen;
  seen.reserve(views_.size());
  BundleProblem problem;
  problem.cameras = {{Transform{}, true}};
  for (const View& view : views_) {
    std::vector<MarkerDetection> one{view.detection};
    undistortAgain(from, &one);
    if (one.empty()) continue;
    const auto pose = estimateSquarePose(one.front(), view.size_m, from.focalLength());
    if (!pose) continue;
    seen.push_back(one.front());
    const int marker = static_cast<int>(problem.markers.size());
    problem.markers.push_back({pose->T_c_m[0], false});
    problem.marker_sizes_m.push_back(view.size_m);
    problem.observations.push_back({0, marker, &seen.back()});
  }
  if (problem.observations.empty()) return std::nullopt;
  problem.lens = {from, from, guess_.intrinsics(), prior_.covariance(guess_)};
  BundleAdjuster adjuster(std::move(problem), options_.optimization);
  const BundleSummary summary =
      runToCompletion([&](Budget* budget) { return adjuster.run(budget); });
  const auto covariance =
      runToCompletion([&](Budget* budget) { return adjuster.globalsCovariance(budget); });
  if (summary.failed || !covariance) return std::nullopt;
  *cost = summary.final_cost;
  // A few squares through a wide lens leave its model open, which the covariance does not know.
  constexpr double kModelDoubt = 2.0;
  return StartingLens{adjuster.problem().lens->camera,
                      kModelDoubt * kModelDoubt * covariance->topLeftCorner<9, 9>()};
}

}  // namespace waymark::slam
