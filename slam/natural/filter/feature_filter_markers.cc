// Of FeatureFilter: fiducial markers in view.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include <Eigen/LU>

#include "slam/covariance/marker_information.h"
#include "slam/natural/filter/feature_filter.h"
#include "slam/natural/filter/se3.h"

namespace waymark::slam {
namespace {

// What is known of a marker that has only just come into view: nothing, but that an update may be
// linear about where its corners have it. As a share of its distance, and radians.
constexpr double kUnplacedSigmaPerDistance = 0.5;
constexpr double kUnplacedSigma_rad = 0.5;

}  // namespace

UnplacedMarker unplacedMarker(const MarkerDetection& detection, double size_m, double focal_px,
                              const MarkerResolverOptions& options) {
  UnplacedMarker marker{&detection, size_m, {}};
  const auto pose = estimateSquarePose(detection, size_m, focal_px, options.square);
  if (pose && pose->unambiguous(options.final_ratio)) marker.T_c_m = pose->T_c_m[0];
  return marker;
}

std::optional<int> FeatureFilter::seenMarker(std::uint64_t id) {
  const auto known = std::ranges::find(markers_seen_, id, &MarkerSeen::id);
  if (known == markers_seen_.end()) return std::nullopt;
  known->time_s = time_s_;
  return state_.findPose(PoseKind::kMarker, id);
}

std::optional<int> FeatureFilter::markerPlace(const KnownMarker& marker) {
  const auto id = static_cast<std::uint64_t>(marker.detection->id);
  if (const auto place = seenMarker(id)) return place;
  if (markers_seen_.size() >= static_cast<std::size_t>(options_.max_markers)) return std::nullopt;
  const auto view = markerInformation(marker.T_w_m, marker.size_m, *marker.detection,
                                      state_.camera(), Matrix6d::Zero());
  if (!view) return std::nullopt;
  const Matrix6d of_view = view->weighted.inverse();
  if (!of_view.allFinite()) return std::nullopt;
  const double share = options_.marker_repeated_share;
  const Matrix6d covariance = marker.covariance + share * share * of_view;
  const Matrix6d A = invariantFromRetract(marker.T_w_m.p);
  const int place =
      state_.addPose(PoseKind::kMarker, id, marker.T_w_m, A * covariance * A.transpose());
  if (place < 0) return std::nullopt;
  markers_seen_.push_back({id, time_s_});
  return place;
}

std::optional<int> FeatureFilter::markerPlace(const UnplacedMarker& marker) {
  const auto id = static_cast<std::uint64_t>(marker.detection->id);
  if (const auto place = seenMarker(id)) return place;
  if (!marker.T_c_m || markers_seen_.size() >= static_cast<std::size_t>(options_.max_markers)) {
    return std::nullopt;
  }
  Vector6d sigma;
  sigma.head<3>().setConstant(kUnplacedSigmaPerDistance * marker.T_c_m->p.norm());
  sigma.tail<3>().setConstant(kUnplacedSigma_rad);
  const Matrix6d A = invariantFromRetract((state_.camera() * *marker.T_c_m).p);
  const Matrix6d covariance = A * sigma.cwiseAbs2().asDiagonal() * A.transpose();
  const int place = state_.addPoseInView(PoseKind::kMarker, id, *marker.T_c_m, covariance);
  if (place < 0) return std::nullopt;
  markers_seen_.push_back({id, time_s_});
  return place;
}

void FeatureFilter::forgetMarker(std::uint64_t id) {
  if (const auto place = state_.findPose(PoseKind::kMarker, id)) state_.removePose(*place);
  std::erase_if(markers_seen_, [&](const MarkerSeen& seen) { return seen.id == id; });
}

void FeatureFilter::forgetMarkers() {
  for (std::size_t i = markers_seen_.size(); i-- > 0;) {
    const MarkerSeen seen = markers_seen_[i];
    if (time_s_ - seen.time_s > options_.marker_memory_s) forgetMarker(seen.id);
  }
}

bool FeatureFilter::observeCorners(int place, const std::array<Eigen::Vector3d, 4>& corners_m,
                                   const MarkerDetection& detection, MarkerOutcome* outcome) {
  state_.compact();
  measurements_.clear();
  for (std::size_t k = 0; k < 4; ++k) {
    measurements_.push_back(
        {place, -1, corners_m[k], detection.normalized[k], detection.covariance[k]});
  }
  linearizeAll(nullptr);
  if (rows_.size() < 4) {
    ++outcome->left_out;
    return true;
  }
  assemble();
  const bool agrees = correct(nullptr, options_.marker_chi2);
  ++(agrees ? outcome->used : outcome->refused);
  return agrees;
}

MarkerOutcome FeatureFilter::observeMarkers(std::span<const KnownMarker> markers) {
  MarkerOutcome outcome;
  forgetMarkers();
  for (const KnownMarker& marker : markers) {
    const auto place = markerPlace(marker);
    if (!place) {
      ++outcome.left_out;
      continue;
    }
    const Transform T_m_w = marker.T_w_m.inverse();
    std::array<Eigen::Vector3d, 4> corners_m;
    std::ranges::transform(marker.corners_w, corners_m.begin(),
                           [&](const Eigen::Vector3d& corner_w) { return T_m_w * corner_w; });
    (void)observeCorners(*place, corners_m, *marker.detection, &outcome);
  }
  return outcome;
}

MarkerOutcome FeatureFilter::observeUnplaced(std::span<const UnplacedMarker> markers) {
  MarkerOutcome outcome;
  for (const UnplacedMarker& marker : markers) {
    const auto place = markerPlace(marker);
    if (!place) {
      ++outcome.left_out;
    } else if (!observeCorners(*place, markerCorners(marker.size_m), *marker.detection, &outcome)) {
      forgetMarker(static_cast<std::uint64_t>(marker.detection->id));
    }
  }
  return outcome;
}

}  // namespace waymark::slam
