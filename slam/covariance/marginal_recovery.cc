#include "slam/covariance/marginal_recovery.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/LU>

#include "base/sorted.h"
#include "slam/covariance/corner_sums.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"
#include "slam/geometry/small_cholesky.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/map/world_reference.h"
#include "slam/optimization/block_kernels.h"
#include "slam/optimization/block_system.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kFindMarker = 0.1;
constexpr double kNotePair = 0.01;
constexpr double kLinearizeView = 0.6;
constexpr double kBlockProduct = 0.06;
constexpr double kTakeBlock = 0.15;

// Where nothing else says where a marker is, this does: standard deviations so large that they
// show, and small enough to keep the system regular.
constexpr double kUnknown_m = 100.0;
constexpr double kUnknown_rad = 10.0;

// The keyframe and the unknown markers it sees: what the elimination's pattern was made for.
struct PatternKeyframe {
  KeyframeId id = -1;
  bool held = false;
  std::vector<int> seen;  // poses of the system, ascending
};

struct Pattern {
  std::vector<int> unknown;  // ids, ascending: the poses of the system
  std::vector<int> given;    // ids: fixed, or seen by nobody
  std::vector<PatternKeyframe> keyframes;

  // -1 for a marker that is no unknown.
  [[nodiscard]] int poseOf(int id) const {
    const auto found = std::ranges::lower_bound(unknown, id);
    return found == unknown.end() || *found != id ? -1 : static_cast<int>(found - unknown.begin());
  }
};

Pattern startPattern(const Map& map, const MarkerOptions& markers) {
  Pattern pattern;
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m) continue;
    const bool nobody_says = map.viewsOf(id).empty() && map.linkedFrom(id).empty();
    const bool fixed = markers.origin_marker == id || nobody_says;
    (fixed ? pattern.given : pattern.unknown).push_back(id);
  }
  return pattern;
}

// What is known of a marker's place but from the keyframes. variance: that of the residuals, in
// whose units the system is.
void addPriors(int id, const Transform& T_w_m, const MarkerOptions& markers, double variance,
               int position, BlockSystem* system) {
  system->diagonal(position) += variance * independentInformation(kUnknown_m, kUnknown_rad);
  for (const Anchor& anchor : markers.anchors) {
    if (anchor.id != id) continue;
    const Matrix6d information =
        variance * independentInformation(anchor.sigma_m, anchor.sigma_rad);
    system->diagonal(position) += information;
    system->right(position) += information * T_w_m.localCoordinates(anchor.T_w_m);
  }
}

// A keyframe's view of a marker.
struct LinearizedView {
  int position = 0;                         // in the system; less than 0 for a marker that is fixed
  Matrix6d information = Matrix6d::Zero();  // A: of the marker, the camera held
  Vector6d gradient = Vector6d::Zero();     // g = J^T W r: of half the squared residuals
  Eigen::Vector3d d_w = Eigen::Vector3d::Zero();  // from the camera to the marker, metres
};

// False when a corner is behind the camera. Corners beyond `huber` pull as in the optimizations.
bool linearize(const Transform& T_w_m, double size_m, const MarkerDetection& detection,
               const Transform& T_w_c, double huber, LinearizedView* view) {
  const auto corners_m = markerCorners(size_m);
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d arm = T_w_m.R.leftCols<2>() * corners_m[k].head<2>();
    Projection projection;
    if (!projectPoint(T_w_c, T_w_m.p + arm, &projection)) return false;
    const Eigen::Matrix2d W = detection.covariance[k].inverse();
    const Eigen::Vector2d r = projection.normalized - detection.normalized[k];
    const Eigen::Vector2d Wr = W * r;
    addSquare(projection.J_point, arm, W, &view->information);
    view->gradient +=
        huberWeight(r.dot(Wr), huber) * transposedJacobianTimes(projection.J_point, arm, Wr);
  }
  mirror(&view->information);
  view->d_w = T_w_m.p - T_w_c.p;
  return true;
}

// The same of a marker that was carried to the keyframe. variance: as in addPriors().
LinearizedView linearizeLink(const Transform& T_w_m, const MarkerLink& link, const Transform& T_w_c,
                             double variance) {
  LinearizedView view;
  view.information = variance * turnedCovariance(T_w_c.R, link.covariance.inverse());
  view.gradient = view.information * (T_w_c * link.T_c_m).localCoordinates(T_w_m);
  view.d_w = T_w_m.p - T_w_c.p;
  return view;
}

std::vector<int> markersOf(const Keyframe& keyframe) {
  std::vector<int> ids;
  keyframe.forEachMarker([&](int id) { ids.push_back(id); });
  sortUnique(&ids);
  return ids;
}

// What the keyframe says of its markers when nobody knows where it was itself: A_i where i = j,
// less A_i T_i C^-1 T_j^T A_j, C = sum T_i^T A_i T_i; and on the right side less g_i, and
// A_i T_i C^-1 sum T_j^T g_j. (Moving the camera is moving all it sees the other way: the camera's
// Jacobian is that of the marker times -T, T = rigidTransport(d).)
void addKeyframe(std::vector<LinearizedView>* views, bool held, std::vector<Matrix6d>* scratch,
                 BlockSystem* system) {
  std::ranges::sort(*views, {}, &LinearizedView::position);
  for (const LinearizedView& view : *views) {
    if (view.position < 0) continue;
    system->diagonal(view.position) += view.information;
    system->right(view.position) -= view.gradient;
  }
  if (held) return;
  Matrix6d C = Matrix6d::Zero();
  Vector6d pull = Vector6d::Zero();
  std::vector<Matrix6d>& Y = *scratch;  // A_i T_i, later times L^-T
  Y.resize(views->size());
  for (std::size_t i = 0; i < views->size(); ++i) {
    const LinearizedView& view = (*views)[i];
    Y[i] = transposedTransport(view.d_w, view.information).transpose();
    C += transposedTransport(view.d_w, Y[i]);
    pull += transposedTransport(view.d_w, view.gradient);
  }
  if (!factorizeCholesky(&C)) return;
  solveLower(C, &pull);
  for (Matrix6d& Y_i : Y) divideByTransposed(C, &Y_i);
  for (std::size_t j = 0; j < views->size(); ++j) {
    if ((*views)[j].position < 0) continue;  // the fixed ones come first
    system->right((*views)[j].position).noalias() += Y[j] * pull;
    for (std::size_t i = j; i < views->size(); ++i) {
      const auto place = system->place((*views)[i].position, (*views)[j].position);
      subtractProduct(Y[i], Y[j], &system->block(place));
    }
  }
}

}  // namespace

Task<MapMarginals> recoverMarginals(const Map& map, const MarkerOptions& markers,
                                    double residual_sigma, Budget* budget) {
  Pattern pattern = startPattern(map, markers);
  const bool first_is_world = firstKeyframeIsWorld(map, markers);
  std::vector<std::vector<int>> neighbours(pattern.unknown.size());
  for (auto it = map.keyframes().begin(); it != map.keyframes().end();) {
    const KeyframeId id = it->first;
    PatternKeyframe keyframe{id, first_is_world && it == map.keyframes().begin(), {}};
    for (const int marker : markersOf(it->second)) {
      const int pose = pattern.poseOf(marker);
      if (pose < 0) continue;
      auto& before = neighbours[static_cast<std::size_t>(pose)];
      before.insert(before.end(), keyframe.seen.begin(), keyframe.seen.end());
      keyframe.seen.push_back(pose);
    }
    const auto n = static_cast<double>(keyframe.seen.size());
    if (!keyframe.seen.empty()) pattern.keyframes.push_back(std::move(keyframe));
    co_await budget->spend(n * (kFindMarker + kNotePair * n));
    it = map.keyframes().upper_bound(id);
  }
  for (auto& of_one : neighbours) sortUnique(&of_one);
  const std::vector<std::vector<int>> pairs = neighbours;  // by pose: those before it

  BlockSystem system;
  (void)co_await system.arrange(std::move(neighbours), /*with_globals=*/false, budget);
  const double huber = BundleOptions{}.huber * residual_sigma;  // as in the optimizations
  const double variance = residual_sigma * residual_sigma;
  std::vector<LinearizedView> views;
  std::vector<Matrix6d> scratch;
  for (const PatternKeyframe& known : pattern.keyframes) {
    const auto n = static_cast<double>(known.seen.size());
    co_await budget->spend(kLinearizeView * n + kBlockProduct * n * (n + 1.0));
    const auto found = map.keyframes().find(known.id);
    if (found == map.keyframes().end()) continue;  // has been let go meanwhile
    views.clear();
    // -1 for one that is fixed; empty for one that the pattern does not have there.
    const auto positionOf = [&](int marker) -> std::optional<int> {
      if (markers.origin_marker == marker) return -1;
      const int pose = pattern.poseOf(marker);
      if (!std::ranges::binary_search(known.seen, pose)) return std::nullopt;
      return system.positionOf(pose);
    };
    for (const MarkerDetection& detection : found->second.detections) {
      const MapMarker* const marker = map.findPosed(detection.id);
      const auto position = positionOf(detection.id);
      if (marker == nullptr || !position) continue;
      LinearizedView view;
      view.position = *position;
      if (linearize(*marker->T_w_m, marker->size_m, detection, found->second.T_w_c, huber, &view)) {
        views.push_back(view);
      }
    }
    for (const MarkerLink& link : found->second.links) {
      const MapMarker* const marker = map.findPosed(link.marker);
      const auto position = positionOf(link.marker);
      if (marker == nullptr || !position || found->second.find(link.marker) != nullptr) continue;
      views.push_back(linearizeLink(*marker->T_w_m, link, found->second.T_w_c, variance));
      views.back().position = *position;
    }
    addKeyframe(&views, known.held, &scratch, &system);
  }
  for (std::size_t i = 0; i < pattern.unknown.size(); ++i) {
    const int id = pattern.unknown[i];
    const MapMarker* const marker = map.findPosed(id);
    const Transform T_w_m = marker == nullptr ? Transform{} : *marker->T_w_m;
    addPriors(id, T_w_m, markers, variance, system.positionOf(static_cast<int>(i)), &system);
  }

  MapMarginals marginals;
  for (const int id : pattern.given) {
    const MapMarker* const marker = map.findPosed(id);
    if (marker == nullptr) continue;
    marginals.set(id,
                  markers.origin_marker == id ? Matrix6d(Matrix6d::Zero()) : marker->covariance);
  }
  if (!co_await system.solve(budget)) co_return MapMarginals{};
  (void)co_await system.invert(budget);
  for (std::size_t a = 0; a < pattern.unknown.size(); ++a) {
    const int row = system.positionOf(static_cast<int>(a));
    const Vector6d& step = system.right(row);
    marginals.set(pattern.unknown[a], variance * system.diagonal(row) + step * step.transpose());
  }
  for (std::size_t b = 0; b < pairs.size(); ++b) {
    co_await budget->spend(kTakeBlock * static_cast<double>(pairs[b].size()));
    const int of_b = system.positionOf(static_cast<int>(b));
    for (const int a : pairs[b]) {
      const int of_a = system.positionOf(a);
      const Matrix6d& block =
          system.block(system.place(std::max(of_a, of_b), std::min(of_a, of_b)));
      const Matrix6d rows_of_a = of_a > of_b ? block : Matrix6d(block.transpose());
      const Matrix6d steps = system.right(of_a) * system.right(of_b).transpose();
      marginals.appendBetween(pattern.unknown[static_cast<std::size_t>(a)], pattern.unknown[b],
                              variance * rows_of_a + steps);
    }
  }
  co_return marginals;
}

}  // namespace waymark::slam
