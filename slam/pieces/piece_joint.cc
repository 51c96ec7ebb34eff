#include "slam/pieces/piece_joint.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>

#include "slam/geometry/turned_covariance.h"
#include "slam/geometry/two_hypotheses.h"
#include "slam/pieces/other_print.h"

namespace waymark::slam {
namespace {

// A frame in one of the pieces.
struct PlaceInPiece {
  Transform T_w_c;
  Matrix6d covariance = Matrix6d::Zero();
  double chi2 = 0.0;
};

// What is known of a camera's place in a bent piece.
Matrix6d bend(double depth_m, const PieceOptions& options) {
  Vector6d sigma;
  sigma.head<3>().setConstant(options.bend_per_depth * depth_m);
  sigma.tail<3>().setConstant(options.bend_rad);
  return sigma.cwiseAbs2().asDiagonal();
}

double meanDepth(std::span<const KnownMarker> markers, const Transform& T_w_c) {
  double depth = 0.0;
  for (const KnownMarker& marker : markers) depth += (marker.T_w_m.p - T_w_c.p).norm();
  return depth / static_cast<double>(markers.size());
}

// Corners are off by more than their covariances say: what a chi-square counts of that.
double chi2Share(std::span<const KnownMarker> markers, const JointParts& parts) {
  const double systematic = parts.square.systematic_sigma_px / parts.camera.focalLength();
  double variance = 0.0;
  for (const KnownMarker& marker : markers) variance += cornerVariance(*marker.detection);
  variance /= static_cast<double>(markers.size());
  return variance / (variance + systematic * systematic);
}

// The best place and the best other one, as each marker's two poses propose them.
std::vector<PlaceInPiece> placesIn(std::span<const KnownMarker> markers, const JointParts& parts) {
  std::vector<PlaceInPiece> found;
  if (markers.empty()) return found;
  const double share = chi2Share(markers, parts);
  std::vector<KnownMarker> proposing(markers.begin(), markers.end());
  std::ranges::sort(proposing, {},
                    [](const KnownMarker& marker) { return cornerVariance(*marker.detection); });
  if (proposing.size() > kProposing) proposing.resize(kProposing);
  for (const KnownMarker& marker : proposing) {
    const auto square = estimateSquarePose(*marker.detection, marker.size_m,
                                           parts.camera.focalLength(), parts.square);
    if (!square) continue;
    for (const Transform& T_c_m : square->T_c_m) {
      const auto solution = parts.optimizer.optimize(markers, marker.T_w_m * T_c_m.inverse());
      if (!solution || !parts.optimizer.acceptable(*solution)) continue;
      const double wanted = parts.options.min_share * static_cast<double>(markers.size());
      if (solution->inliers < wanted) continue;
      found.push_back(
          {solution->T_w_c,
           solution->covariance + bend(meanDepth(markers, solution->T_w_c), parts.options),
           share * solution->chi2});
    }
  }
  std::ranges::sort(found, {}, &PlaceInPiece::chi2);
  std::vector<PlaceInPiece> places;
  for (const PlaceInPiece& place : found) {
    const bool another = std::ranges::all_of(places, [&](const PlaceInPiece& known) {
      return isAnotherPose(place.T_w_c, known.T_w_c, parts.options.other_rotation_rad);
    });
    if (another && places.size() < 2) places.push_back(place);
  }
  return places;
}

// T_a_b = T_a_c * T_c_b, with what is not known of either: the derivatives are those of Transform's
// local coordinates.
JointView::Way wayOf(const PlaceInPiece& in_a, const PlaceInPiece& in_b) {
  JointView::Way way;
  way.T_a_b = in_a.T_w_c * in_b.T_w_c.inverse();
  const Eigen::Matrix3d& R = way.T_a_b.R;
  const Eigen::Matrix3d lever = skew(R * in_b.T_w_c.p);
  Matrix6d J_a = Matrix6d::Identity();
  J_a.topRightCorner<3, 3>() = lever;
  Matrix6d J_b = Matrix6d::Zero();
  J_b.topLeftCorner<3, 3>() = -R;
  J_b.topRightCorner<3, 3>() = -lever * R;
  J_b.bottomRightCorner<3, 3>() = -R;
  const Matrix6d covariance =
      J_a * in_a.covariance * J_a.transpose() + J_b * in_b.covariance * J_b.transpose();
  way.information = covariance.ldlt().solve(Matrix6d::Identity());
  way.chi2 = in_a.chi2 + in_b.chi2;
  return way;
}

// As the features say that carried the camera there from a marker of the piece.
std::optional<PlaceInPiece> placeByLink(const Map& own, const Keyframe& keyframe,
                                        const JointParts& parts) {
  for (const MarkerLink& link : keyframe.links) {
    const MapMarker* const anchor = own.findPosed(link.marker);
    if (anchor == nullptr) continue;
    const Matrix6d in_marker = covarianceOfInverse(link.T_c_m, link.covariance);
    return PlaceInPiece{keyframe.T_w_c, turnedCovariance(anchor->T_w_m->R, in_marker) +
                                            bend(link.T_c_m.p.norm(), parts.options)};
  }
  return std::nullopt;
}

std::optional<JointView> viewOf(const std::vector<PlaceInPiece>& places_a,
                                const std::vector<PlaceInPiece>& places_b) {
  if (places_a.empty() || places_b.empty()) return std::nullopt;
  JointView view;
  for (const PlaceInPiece& a : places_a) {
    for (const PlaceInPiece& b : places_b) view.ways.push_back(wayOf(a, b));
  }
  const double least = std::ranges::min(view.ways, {}, &JointView::Way::chi2).chi2;
  for (JointView::Way& way : view.ways) way.chi2 -= least;
  return view;
}

double distance2(const JointView::Way& way, const Transform& T_a_b) {
  const Vector6d d = way.T_a_b.localCoordinates(T_a_b);
  return d.dot(way.information * d);
}

// The way of a view that a hypothesis is nearest to, and what the two are apart, with what the
// view's own corners say against that way.
std::pair<const JointView::Way*, double> nearestWay(const JointView& view, const Transform& T_a_b) {
  std::pair<const JointView::Way*, double> nearest{nullptr, std::numeric_limits<double>::max()};
  for (const JointView::Way& way : view.ways) {
    const double cost = way.chi2 + distance2(way, T_a_b);
    if (cost < nearest.second) nearest = {&way, cost};
  }
  return nearest;
}

struct Hypothesis {
  Transform T_a_b;
  double cost = 0.0;
  Matrix6d information = Matrix6d::Zero();
  int views = 0;
};

// A contradicting view counts for as much as two ways are to be told apart by.
double costOf(std::span<const JointView> views, const Transform& T_a_b, double cut) {
  double cost = 0.0;
  for (const JointView& view : views) cost += std::min(nearestWay(view, T_a_b).second, cut);
  return cost;
}

// The mean of the ways that are nearest, where these do not contradict it.
Hypothesis refined(std::span<const JointView> views, const Transform& start, double cut,
                   const PieceOptions& options) {
  constexpr int kIterations = 3;
  Hypothesis hypothesis{start};
  for (int i = 0; i < kIterations; ++i) {
    Matrix6d information = Matrix6d::Zero();
    Vector6d sum = Vector6d::Zero();
    hypothesis.views = 0;
    for (const JointView& view : views) {
      const auto [way, cost] = nearestWay(view, hypothesis.T_a_b);
      if (distance2(*way, hypothesis.T_a_b) > options.max_chi2) continue;
      information += way->information;
      sum += way->information * hypothesis.T_a_b.localCoordinates(way->T_a_b);
      ++hypothesis.views;
    }
    if (hypothesis.views == 0) break;
    hypothesis.information = information;
    hypothesis.T_a_b = hypothesis.T_a_b.retract(information.ldlt().solve(sum));
  }
  hypothesis.cost = costOf(views, hypothesis.T_a_b, cut);
  return hypothesis;
}

}  // namespace

std::optional<JointView> viewJoint(std::span<const KnownMarker> in_a,
                                   std::span<const KnownMarker> in_b, const JointParts& parts) {
  return viewOf(placesIn(in_a, parts), placesIn(in_b, parts));
}

std::optional<JointView> viewJoint(const Map& a, const Map& b, const Map& own,
                                   const Keyframe& keyframe, const JointParts& parts) {
  const std::vector<MarkerDetection> seen(keyframe.detections.begin(), keyframe.detections.end());
  const std::vector<KnownMarker> known = knownMarkers(own, seen);
  const auto linked = known.empty() ? placeByLink(own, keyframe, parts) : std::nullopt;
  if (!linked) return viewJoint(a, b, seen, parts);
  const std::vector<PlaceInPiece> here = {*linked};
  return &own == &a ? viewOf(here, placesIn(knownMarkers(b, seen), parts))
                    : viewOf(placesIn(knownMarkers(a, seen), parts), here);
}

std::optional<JointView> viewJoint(const Map& a, const Map& b,
                                   std::span<const MarkerDetection> detections,
                                   const JointParts& parts) {
  auto view = viewJoint(knownMarkers(a, detections), knownMarkers(b, detections), parts);
  if (view) {
    view->other_print =
        isAnotherPrint(a, detections, parts) || isAnotherPrint(b, detections, parts);
  }
  return view;
}

bool contradicts(const JointView& view, const Transform& T_a_b, const PieceOptions& options) {
  if (view.other_print) return true;
  const auto [way, cost] = nearestWay(view, T_a_b);
  return distance2(*way, T_a_b) > options.max_chi2;
}

bool overlap(const Map& a, const Map& b, const Transform& T_a_b) {
  // Much nearer than prints side by side: maps are bent, and one may meet another by chance.
  constexpr double kShare = 0.35;
  constexpr int kEnough = 2;
  struct Place {
    Eigen::Vector3d p;
    Eigen::Vector3d normal;  // on the other side of a thin wall it is the opposite one
    double size_m = 0.0;
  };
  int same = 0;
  std::vector<Place> theirs;
  double largest_m = 0.0;
  for (const auto& [id, marker] : b.markers()) {
    if (!marker.T_w_m) continue;
    const Transform T_a_m = T_a_b * *marker.T_w_m;
    theirs.push_back({T_a_m.p, T_a_m.R.col(2), marker.size_m});
    largest_m = std::max(largest_m, marker.size_m);
  }
  const auto x = [](const Place& place) { return place.p.x(); };
  std::ranges::sort(theirs, {}, x);
  for (const auto& [id, marker] : a.markers()) {
    if (!marker.T_w_m) continue;
    const Eigen::Vector3d& p = marker.T_w_m->p;
    const double reach_m = kShare * std::max(largest_m, marker.size_m);
    for (auto near = std::ranges::lower_bound(theirs, p.x() - reach_m, {}, x);
         near != theirs.end() && near->p.x() <= p.x() + reach_m; ++near) {
      const bool faces = near->normal.dot(marker.T_w_m->R.col(2)) > 0.5;
      if (faces && (near->p - p).norm() < kShare * 0.5 * (near->size_m + marker.size_m)) ++same;
    }
  }
  return same >= kEnough;
}

std::optional<PieceJoint> estimateJoint(std::span<const JointView> all,
                                        const PieceOptions& options) {
  // An id that hangs twice says nothing, or that nothing else does either.
  std::vector<JointView> views;
  std::ranges::copy_if(all, std::back_inserter(views),
                       [](const JointView& view) { return !view.other_print; });
  if (views.size() < options.min_share * static_cast<double>(all.size())) return std::nullopt;
  if (views.empty()) return std::nullopt;
  const bool few = static_cast<int>(views.size()) < options.enough_views;
  const double wanted = few ? options.ratio_of_few_views : options.ambiguity_ratio;
  const double floor = SquarePoseOptions{}.evidence_floor;
  const double cut = options.ratio_of_few_views * floor;
  std::vector<Hypothesis> hypotheses;
  for (const JointView& view : views) {
    for (const JointView::Way& way : view.ways) {
      hypotheses.push_back({way.T_a_b, costOf(views, way.T_a_b, cut)});
    }
  }
  std::ranges::sort(hypotheses, {}, &Hypothesis::cost);
  const Hypothesis best = refined(views, hypotheses.front().T_a_b, cut, options);
  if (best.views < options.min_share * static_cast<double>(views.size()) || best.views == 0) {
    return std::nullopt;
  }
  const auto other = otherHypothesis(
      hypotheses, best.T_a_b, options.other_rotation_rad,
      [&](const Hypothesis& rival) {
        return std::optional(refined(views, rival.T_a_b, cut, options));
      },
      [](const Hypothesis& hypothesis) { return hypothesis.T_a_b; });
  PieceJoint joint{best.T_a_b, best.information.ldlt().solve(Matrix6d::Identity()), best.views,
                   std::numeric_limits<double>::infinity()};
  if (other) joint.ratio = (other->cost + floor) / (best.cost + floor);
  if (joint.ratio < wanted) return std::nullopt;
  return joint;
}

}  // namespace waymark::slam
