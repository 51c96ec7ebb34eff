#include "tools/evaluation/evaluation.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <string>

#include "slam/geometry/align_points.h"

namespace waymark::tools {
namespace {

struct MatchedPose {
  slam::Transform truth;
  slam::Transform estimate;
};

// Each pose is used once: where two claim the same partner, the nearer one has it.
std::vector<MatchedPose> associate(io::Trajectory truth, io::Trajectory estimate,
                                   std::int64_t tolerance_ns) {
  sortByTime(&truth);
  sortByTime(&estimate);
  struct Claim {
    std::int64_t distance_ns;
    const slam::Transform* pose;
  };
  std::map<std::size_t, Claim> claims;  // by index into truth
  std::size_t nearest = 0;
  for (const io::StampedPose& pose : estimate) {
    const auto distance = [&](std::size_t i) { return std::abs(truth[i].time_ns - pose.time_ns); };
    while (nearest + 1 < truth.size() && distance(nearest + 1) <= distance(nearest)) ++nearest;
    if (truth.empty() || distance(nearest) > tolerance_ns) continue;
    const auto [claim, is_new] = claims.try_emplace(nearest, Claim{distance(nearest), &pose.T_w_c});
    if (!is_new && distance(nearest) < claim->second.distance_ns) {
      claim->second = {distance(nearest), &pose.T_w_c};
    }
  }
  std::vector<MatchedPose> matched;
  for (const auto& [i, claim] : claims) matched.push_back({truth[i].T_w_c, *claim.pose});
  return matched;
}

ErrorStatistics distances(std::span<const Eigen::Vector3d> from,
                          std::span<const Eigen::Vector3d> to, const slam::Transform& T_to_from) {
  std::vector<double> errors;
  for (std::size_t i = 0; i < from.size(); ++i) {
    errors.push_back((T_to_from * from[i] - to[i]).norm());
  }
  return errorStatistics(std::move(errors));
}

// From every pose to the first one at least segment_m further along the true path.
void addRelativeErrors(const std::vector<MatchedPose>& poses, double segment_m,
                       TrajectoryErrors* result) {
  std::vector<double> path_m(poses.size(), 0.0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    path_m[i] = path_m[i - 1] + (poses[i].truth.p - poses[i - 1].truth.p).norm();
  }
  double translation_m = 0.0;
  double rotation_rad = 0.0;
  std::size_t last = 0;
  for (std::size_t first = 0; first < poses.size(); ++first) {
    while (last < poses.size() && path_m[last] < path_m[first] + segment_m) ++last;
    if (last == poses.size()) break;
    const slam::Transform truth = poses[first].truth.inverse() * poses[last].truth;
    const slam::Transform estimate = poses[first].estimate.inverse() * poses[last].estimate;
    const slam::Transform error = estimate.inverse() * truth;
    translation_m += error.p.norm();
    rotation_rad += slam::logSo3(error.R).norm();
    ++result->segments;
  }
  if (result->segments == 0) return;
  const auto count = static_cast<double>(result->segments);
  result->t_rel_percent = 100.0 * translation_m / count / segment_m;
  result->r_rel_deg = rotation_rad / count * 180.0 / std::numbers::pi;
}

}  // namespace

ErrorStatistics errorStatistics(std::vector<double> errors) {
  if (errors.empty()) return {};
  std::sort(errors.begin(), errors.end());
  const auto count = static_cast<double>(errors.size());
  const std::size_t half = errors.size() / 2;
  ErrorStatistics statistics;
  statistics.mean = std::accumulate(errors.begin(), errors.end(), 0.0) / count;
  statistics.rms =
      std::sqrt(std::inner_product(errors.begin(), errors.end(), errors.begin(), 0.0) / count);
  statistics.median =
      errors.size() % 2 == 1 ? errors[half] : 0.5 * (errors[half - 1] + errors[half]);
  statistics.max = errors.back();
  return statistics;
}

void sortByTime(io::Trajectory* trajectory) {
  std::stable_sort(
      trajectory->begin(), trajectory->end(),
      [](const io::StampedPose& a, const io::StampedPose& b) { return a.time_ns < b.time_ns; });
}

const io::StampedPose* nearestPose(const io::Trajectory& trajectory, std::int64_t time_ns,
                                   std::int64_t tolerance_ns) {
  const auto after = std::lower_bound(
      trajectory.begin(), trajectory.end(), time_ns,
      [](const io::StampedPose& pose, std::int64_t time) { return pose.time_ns < time; });
  const io::StampedPose* nearest = after == trajectory.end() ? nullptr : &*after;
  if (after != trajectory.begin()) {
    const io::StampedPose& before = *std::prev(after);
    if (nearest == nullptr || time_ns - before.time_ns < nearest->time_ns - time_ns) {
      nearest = &before;
    }
  }
  if (nearest == nullptr || std::abs(nearest->time_ns - time_ns) > tolerance_ns) return nullptr;
  return nearest;
}

Result<TrajectoryErrors> compareTrajectories(const io::Trajectory& truth,
                                             const io::Trajectory& estimate,
                                             const TrajectoryOptions& options) {
  const std::vector<MatchedPose> poses = associate(truth, estimate, options.tolerance_ns);
  if (poses.empty()) {
    return Error{"no pose of the estimate is within " +
                 std::to_string(static_cast<double>(options.tolerance_ns) * 1e-6) +
                 " ms of one of the truth"};
  }
  TrajectoryErrors result;
  result.truth_poses = truth.size();
  result.matched = poses.size();
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const MatchedPose& pose : poses) {
    from.push_back(pose.estimate.p);
    to.push_back(pose.truth.p);
  }
  result.T_truth_est = slam::alignPoints(from, to);
  result.ate_m = distances(from, to, result.T_truth_est);
  addRelativeErrors(poses, options.segment_m, &result);
  return result;
}

ViewCoverage viewCoverage(std::span<const io::VisibleMarker> visible,
                          std::span<const io::MarkerCorners> map, io::Trajectory estimate,
                          const ViewCoverageOptions& options) {
  std::set<int> mapped;
  for (const io::MarkerCorners& marker : map) mapped.insert(marker.id);
  std::set<std::int64_t> times_ns;
  for (const io::VisibleMarker& marker : visible) {
    if (marker.side_px >= options.min_side_px && mapped.contains(marker.id)) {
      times_ns.insert(marker.time_ns);
    }
  }
  sortByTime(&estimate);
  ViewCoverage coverage{times_ns.size(), 0};
  for (const std::int64_t time_ns : times_ns) {
    if (nearestPose(estimate, time_ns, options.tolerance_ns) != nullptr) ++coverage.localized;
  }
  return coverage;
}

Result<MapErrors> compareMaps(std::span<const io::MarkerCorners> truth,
                              std::span<const io::MarkerCorners> estimate) {
  std::map<int, const io::MarkerCorners*> unmatched;
  for (const io::MarkerCorners& marker : estimate) unmatched[marker.id] = &marker;
  MapErrors result;
  struct Corners {
    std::vector<Eigen::Vector3d> estimate, truth;
  };
  std::map<int, Corners> pieces;
  for (const io::MarkerCorners& marker : truth) {
    const auto found = unmatched.find(marker.id);
    if (found == unmatched.end()) {
      result.missing.push_back(marker.id);
      continue;
    }
    const io::MarkerCorners& ours = *found->second;
    Corners& piece = pieces[ours.piece];
    piece.estimate.insert(piece.estimate.end(), ours.corners.begin(), ours.corners.end());
    piece.truth.insert(piece.truth.end(), marker.corners.begin(), marker.corners.end());
    unmatched.erase(found);
    ++result.common;
  }
  for (const auto& [id, marker] : unmatched) result.unknown.push_back(id);
  if (result.common == 0) return Error{"no marker is in both maps"};
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (auto& [id, piece] : pieces) {
    const slam::Transform T_truth_est = slam::alignPoints(piece.estimate, piece.truth);
    for (Eigen::Vector3d& corner : piece.estimate) corner = T_truth_est * corner;
    from.insert(from.end(), piece.estimate.begin(), piece.estimate.end());
    to.insert(to.end(), piece.truth.begin(), piece.truth.end());
    result.pieces.push_back(
        {id, piece.truth.size() / 4, distances(piece.estimate, piece.truth, {})});
  }
  result.ace_m = distances(from, to, {});
  return result;
}

}  // namespace waymark::tools
