#include "slam/map/world_reference.h"

#include <algorithm>
#include <cmath>

#include <Eigen/SVD>

#include "slam/geometry/align_points.h"
#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {
namespace {

struct Survey {
  std::vector<Eigen::Vector3d> in_map;  // metres
  std::vector<Eigen::Vector3d> in_world;
  double worst_sigma_m = 0.0;
};

Survey surveyOf(const Map& map, const MarkerOptions& markers) {
  Survey survey;
  for (const SurveyedPosition& position : markers.constraints.positions) {
    const MapMarker* const marker = map.findPosed(position.id);
    if (marker == nullptr) continue;
    survey.in_map.push_back(marker->T_w_m->p);
    survey.in_world.push_back(position.p_w);
    survey.worst_sigma_m = std::max(survey.worst_sigma_m, position.sigma_m);
  }
  return survey;
}

// Root mean square distance from the line that is nearest to them, metres.
double spreadAcross(const std::vector<Eigen::Vector3d>& points) {
  const auto count = static_cast<Eigen::Index>(points.size());
  Eigen::Matrix3Xd centred(3, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    centred.col(i) = points[static_cast<std::size_t>(i)];
  }
  centred.colwise() -= centred.rowwise().mean().eval();
  const Eigen::JacobiSVD<Eigen::Matrix3Xd> svd(centred);
  return svd.singularValues()[1] / std::sqrt(static_cast<double>(count));
}

}  // namespace

bool positionsFixWorld(const Map& map, const MarkerOptions& markers) {
  constexpr std::size_t kFewest = 3;
  if (markers.constraints.positions.size() < kFewest) return false;
  // Then the turn about the line is known to some hundredths of a radian.
  constexpr double kSigmasAcross = 20.0;
  const Survey survey = surveyOf(map, markers);
  return survey.in_world.size() >= kFewest &&
         spreadAcross(survey.in_world) > kSigmasAcross * survey.worst_sigma_m;
}

bool isInSurvey(const Map& map, const MarkerOptions& markers) {
  const auto has_place = [&](int id) { return map.findPosed(id) != nullptr; };
  return std::ranges::any_of(markers.anchors, has_place, &Anchor::id) ||
         positionsFixWorld(map, markers);
}

Transform surveyedFromMap(const Map& map, const MarkerOptions& markers) {
  const Survey survey = surveyOf(map, markers);
  return alignPoints(survey.in_map, survey.in_world);
}

Matrix6d surveyCovariance(const Map& map, const MarkerOptions& markers) {
  Matrix6d information = Matrix6d::Zero();
  for (const Anchor& anchor : markers.anchors) {
    if (map.findPosed(anchor.id) == nullptr) continue;
    information += independentInformation(anchor.sigma_m, anchor.sigma_rad);
  }
  if (positionsFixWorld(map, markers)) {
    // As sure of a turn as the points are far from the line that is nearest to them.
    const Survey survey = surveyOf(map, markers);
    const double sigma_rad = survey.worst_sigma_m / spreadAcross(survey.in_world);
    information += static_cast<double>(survey.in_world.size()) *
                   independentInformation(survey.worst_sigma_m, sigma_rad);
  }
  return information.diagonal().cwiseInverse().asDiagonal();
}

bool firstKeyframeIsWorld(const Map& map, const MarkerOptions& markers) {
  return !markers.origin_marker && !isInSurvey(map, markers);
}

bool WorldReference::isMissing(const Map& map) {
  if (found_) return false;
  const bool surveyed = !markers_.anchors.empty() || !markers_.constraints.positions.empty();
  const bool missing = markers_.origin_marker ? map.findPosed(*markers_.origin_marker) == nullptr
                                              : surveyed && !isInSurvey(map, markers_);
  found_ = !missing;
  return missing;
}

}  // namespace waymark::slam
