#include "slam/pieces/piece_joint.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include <Eigen/Cholesky>

#include "slam/geometry/two_hypotheses.h"

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
  const double systematic = parts.square.systematic_sigma_px / parts.focal_px;
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
  for (const KnownMarker& marker : markers) {
    const auto square =
        estimateSquarePose(*marker.detection, marker.size_m, parts.focal_px, parts.square);
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

// The keyframes of `a` that see what only `b` knows.
void addFrames(const Map& a, const Map& b, std::set<std::pair<int, KeyframeId>>* frames) {
  for (const auto& [id, marker] : a.markers()) {
    if (marker.T_w_m || b.findPosed(id) == nullptr) continue;
    for (const KeyframeId keyframe : a.viewsOf(id)) frames->insert({a.piece, keyframe});
  }
}

}  // namespace

std::optional<JointView> viewJoint(std::span<const KnownMarker> in_a,
                                   std::span<const KnownMarker> in_b, const JointParts& parts) {
  const std::vector<PlaceInPiece> places_a = placesIn(in_a, parts);
  if (places_a.empty()) return std::nullopt;
  const std::vector<PlaceInPiece> places_b = placesIn(in_b, parts);
  if (places_b.empty()) return std::nullopt;
  JointView view;
  for (const PlaceInPiece& a : places_a) {
    for (const PlaceInPiece& b : places_b) view.ways.push_back(wayOf(a, b));
  }
  const double least = std::ranges::min(view.ways, {}, &JointView::Way::chi2).chi2;
  for (JointView::Way& way : view.ways) way.chi2 -= least;
  return view;
}

std::vector<JointView> connectingViews(const Map& a, const Map& b, const JointParts& parts) {
  std::set<std::pair<int, KeyframeId>> frames;
  addFrames(a, b, &frames);
  addFrames(b, a, &frames);
  const std::vector<std::pair<int, KeyframeId>> all(frames.begin(), frames.end());
  const std::size_t count = std::min(all.size(), static_cast<std::size_t>(parts.options.max_views));
  std::vector<JointView> views;
  for (std::size_t k = 0; k < count; ++k) {
    const auto& [piece, id] = all[k * all.size() / count];
    const Keyframe& keyframe = (piece == a.piece ? a : b).keyframes().at(id);
    const std::vector<MarkerDetection> detections(keyframe.detections.begin(),
                                                  keyframe.detections.end());
    auto view = viewJoint(knownMarkers(a, detections), knownMarkers(b, detections), parts);
    if (view) views.push_back(std::move(*view));
  }
  return views;
}

std::optional<PieceJoint> estimateJoint(std::span<const JointView> views,
                                        const PieceOptions& options) {
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
