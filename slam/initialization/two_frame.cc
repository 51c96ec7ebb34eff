#include "slam/initialization/two_frame.h"

#include <algorithm>
#include <limits>
#include <optional>

#include "slam/geometry/reprojection.h"
#include "slam/geometry/two_hypotheses.h"
#include "slam/marker_pose/marker_resolver.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// A marker seen in both frames, with both solutions of each (theta_m^0 and theta_m^1).
struct CommonMarker {
  const MarkerDetection* seen[2] = {nullptr, nullptr};
  SquarePose solutions[2];
  double size_m = 0.0;
};

std::vector<CommonMarker> commonMarkers(std::span<const MarkerDetection> first,
                                        std::span<const MarkerDetection> second,
                                        const MarkerOptions& markers, double focal_px,
                                        const SquarePoseOptions& square) {
  std::vector<CommonMarker> common;
  for (const MarkerDetection& a : first) {
    const auto b = std::find_if(second.begin(), second.end(),
                                [&](const MarkerDetection& d) { return d.id == a.id; });
    if (b == second.end()) continue;
    const double size_m = markers.sizeOf(a.id);
    const auto in_first = estimateSquarePose(a, size_m, focal_px, square);
    const auto in_second = estimateSquarePose(*b, size_m, focal_px, square);
    if (!in_first || !in_second) continue;
    common.push_back({{&a, &*b}, {*in_first, *in_second}, size_m});
  }
  return common;
}

// e_m^t of Eq. 11, whitened; at most `unseen`, as behind the camera.
double reprojectionError(const MarkerDetection& detection, double size_m, const Transform& T_c_m,
                         double unseen) {
  double error = 0.0;
  const auto corners = markerCorners(size_m);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto squared = squaredError(Transform{}, T_c_m * corners[k], detection.normalized[k],
                                      whitening(detection.covariance[k]));
    if (!squared) return unseen;
    error += *squared;
  }
  return std::min(error, unseen);
}

// beta of Eq. 17 for the motion T_0_1.
double motionError(const std::vector<CommonMarker>& common, const Transform& T_0_1, double unseen) {
  const auto errorOf = [unseen](const CommonMarker& m, int frame, const Transform& T_c_m) {
    return reprojectionError(*m.seen[frame], m.size_m, T_c_m, unseen);
  };
  const Transform T_1_0 = T_0_1.inverse();
  double beta = 0.0;
  for (const CommonMarker& m : common) {
    const auto& in_first = m.solutions[0].T_c_m;
    const auto& in_second = m.solutions[1].T_c_m;
    beta += std::min(errorOf(m, 1, T_1_0 * in_first[0]), errorOf(m, 1, T_1_0 * in_first[1]));
    beta += std::min(errorOf(m, 0, T_0_1 * in_second[0]), errorOf(m, 0, T_0_1 * in_second[1]));
  }
  return beta;
}

// A motion, both cameras and all markers adjusted to it.
struct Motion {
  Transform T_0_1;
  double error = 0.0;
};

// The motion refined together with the common markers' poses, started where Eq. 19-20 put them.
Motion refine(const std::vector<CommonMarker>& common, const Transform& T_0_1,
              const TwoFrameOptions& options) {
  const double unseen = options.square.unseen_chi2;
  BundleProblem problem;
  problem.cameras = {{Transform{}, true}, {T_0_1, false}};
  for (const CommonMarker& m : common) {
    Transform best;
    double least = std::numeric_limits<double>::max();
    for (int frame = 0; frame < 2; ++frame) {
      for (const Transform& T_c_m : m.solutions[frame].T_c_m) {
        const Transform T_0_m = frame == 0 ? T_c_m : T_0_1 * T_c_m;
        const double error =
            reprojectionError(*m.seen[0], m.size_m, T_0_m, unseen) +
            reprojectionError(*m.seen[1], m.size_m, T_0_1.inverse() * T_0_m, unseen);
        if (error >= least) continue;
        least = error;
        best = T_0_m;
      }
    }
    const int index = static_cast<int>(problem.markers.size());
    problem.markers.push_back({best, false});
    problem.marker_sizes_m.push_back(m.size_m);
    problem.observations.push_back({0, index, m.seen[0]});
    problem.observations.push_back({1, index, m.seen[1]});
  }
  const BundleSummary summary = adjustBundle(&problem, options.refinement);
  return {problem.cameras[1].T, std::min(summary.final_cost, unseen)};
}

// C^{1,0} of Eq. 15-16, the best by Eq. 17 first.
std::vector<Motion> proposeMotions(const std::vector<CommonMarker>& common, double unseen) {
  std::vector<Motion> motions;
  for (const CommonMarker& m : common) {
    for (const Transform& T_0_m : m.solutions[0].T_c_m) {
      for (const Transform& T_1_m : m.solutions[1].T_c_m) {
        const Transform T_0_1 = T_0_m * T_1_m.inverse();
        motions.push_back({T_0_1, motionError(common, T_0_1, unseen)});
      }
    }
  }
  std::sort(motions.begin(), motions.end(),
            [](const Motion& a, const Motion& b) { return a.error < b.error; });
  return motions;
}

// The best motion that stays another one after refinement; empty when there is none.
std::optional<Motion> otherMotion(const std::vector<CommonMarker>& common,
                                  const std::vector<Motion>& motions, const Motion& best,
                                  const TwoFrameOptions& options) {
  return otherHypothesis(
      motions, best.T_0_1, options.other_rotation_rad,
      [&](const Motion& rival) { return std::optional(refine(common, rival.T_0_1, options)); },
      [](const Motion& motion) { return motion.T_0_1; });
}

double meanDepth(const std::vector<CommonMarker>& common) {
  double depth = 0.0;
  for (const CommonMarker& m : common) depth += m.solutions[0].T_c_m[0].p.norm();
  return depth / static_cast<double>(common.size());
}

// Eq. 19-20: each marker's pose from both frames, where it is decided.
std::vector<InitialMarker> markerPoses(const std::vector<CommonMarker>& common,
                                       const Transform& T_0_1, double focal_px,
                                       const TwoFrameOptions& options) {
  const MarkerResolverOptions resolver{
      .min_views = 2, .ambiguity_ratio = options.ambiguity_ratio, .square = options.square};
  std::vector<InitialMarker> markers;
  for (const CommonMarker& m : common) {
    const MarkerView views[] = {{m.seen[0], Transform{}}, {m.seen[1], T_0_1}};
    const MarkerResolution found = resolveMarkerPose(views, m.size_m, focal_px, 1.0, resolver);
    if (found.verdict != ResolverVerdict::kResolved) continue;
    markers.push_back({m.seen[0]->id, found.T_w_m, found.other_T_w_m});
  }
  return markers;
}

double meanCornerVariance(const std::vector<CommonMarker>& common) {
  double variance = 0.0;
  for (const CommonMarker& m : common) {
    variance += 0.5 * (cornerVariance(*m.seen[0]) + cornerVariance(*m.seen[1]));
  }
  return variance / static_cast<double>(common.size());
}

}  // namespace

std::string TwoFrameOptions::invalidReason() const {
  return firstReason({
      firstUnmet({
          {isPositive(min_baseline_m) && isNotNegative(min_baseline_per_depth),
           "the baseline of two frames must be positive"},
          {isPositive(worst_chi2_per_marker), "the chi-square of two frames must be positive"},
          {ambiguity_ratio >= 1.0, "ambiguity ratios must be at least 1"},
          {isNotNegative(other_rotation_rad), "the turn to another pose must not be negative"},
      }),
      refinement.invalidReason(),
      square.invalidReason(),
  });
}

std::variant<TwoFrameStart, TwoFrameFailure> initializeFromTwoFrames(
    std::span<const MarkerDetection> first, std::span<const MarkerDetection> second,
    const MarkerOptions& markers, double focal_px, const TwoFrameOptions& options) {
  const std::vector<CommonMarker> common =
      commonMarkers(first, second, markers, focal_px, options.square);
  if (common.empty()) return TwoFrameFailure::kNoCommonMarker;
  const std::vector<Motion> motions = proposeMotions(common, options.square.unseen_chi2);
  const Motion best = refine(common, motions.front().T_0_1, options);
  const double baseline =
      std::max(options.min_baseline_m, options.min_baseline_per_depth * meanDepth(common));
  if (best.T_0_1.p.norm() < baseline) return TwoFrameFailure::kShortBaseline;
  const double n = static_cast<double>(common.size());
  if (best.error > options.worst_chi2_per_marker * n) return TwoFrameFailure::kPoorFit;
  if (const auto other = otherMotion(common, motions, best, options)) {
    const double floor = comparisonFloor(meanCornerVariance(common), focal_px,
                                         2 * static_cast<int>(common.size()), options.square);
    if ((other->error + floor) / (best.error + floor) < options.ambiguity_ratio) {
      return TwoFrameFailure::kAmbiguous;
    }
  }
  TwoFrameStart start{best.T_0_1, markerPoses(common, best.T_0_1, focal_px, options)};
  if (start.markers.empty()) return TwoFrameFailure::kAmbiguous;
  return start;
}

}  // namespace waymark::slam
