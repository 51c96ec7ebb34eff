#include "slam/covariance/marginal_recovery.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/sorted.h"
#include "slam/covariance/marker_information.h"
#include "slam/geometry/small_cholesky.h"
#include "slam/optimization/block_kernels.h"
#include "slam/optimization/block_system.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kFindMarker = 0.1;
constexpr double kLinearizeView = 0.5;
constexpr double kBlockProduct = 0.06;
constexpr double kTakeBlock = 0.15;

// Where nothing else says where a marker is, this does: standard deviations so large that they
// show, and small enough to keep the system regular.
constexpr double kUnknown_m = 100.0;
constexpr double kUnknown_rad = 10.0;

// The keyframe and the unknown markers it sees, as poses of the system: what the elimination's
// pattern was made for.
struct PatternKeyframe {
  KeyframeId id = -1;
  bool held = false;
  std::vector<int> seen;  // unknown ones, ids, ascending
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
    const bool fixed = markers.origin_marker == id || map.viewsOf(id).empty();
    (fixed ? pattern.given : pattern.unknown).push_back(id);
  }
  return pattern;
}

// Information on a marker's place where there is any but the keyframes'.
Matrix6d priorInformation(int id, const MarkerOptions& markers) {
  Matrix6d information = Matrix6d::Zero();
  const auto add = [&](double sigma_m, double sigma_rad) {
    information.diagonal().head<3>().array() += 1.0 / (sigma_m * sigma_m);
    information.diagonal().tail<3>().array() += 1.0 / (sigma_rad * sigma_rad);
  };
  add(kUnknown_m, kUnknown_rad);
  for (const Anchor& anchor : markers.anchors) {
    if (anchor.id == id) add(anchor.sigma_m, anchor.sigma_rad);
  }
  return information;
}

// A keyframe's view of a marker.
struct LinearizedView {
  int position = 0;      // in the system; less than 0 for a marker that is fixed
  Matrix6d information;  // A: of the marker, the camera held
  Matrix6d transport;    // T: from the camera's motion to the marker's
};

// What the keyframe says of its markers when nobody knows where it was itself: A_i where i = j,
// less A_i T_i C^-1 T_j^T A_j, C = sum T_i^T A_i T_i. (Moving the camera is moving all it sees the
// other way: the camera's Jacobian is that of the marker times -T.)
void addKeyframe(std::vector<LinearizedView>* views, bool held, BlockSystem* system) {
  std::ranges::sort(*views, {}, &LinearizedView::position);
  for (const LinearizedView& view : *views) {
    if (view.position >= 0) system->diagonal(view.position) += view.information;
  }
  if (held) return;
  Matrix6d C = Matrix6d::Zero();
  std::vector<Matrix6d> Y(views->size());  // transposed: A_i T_i, later times L^-T
  for (std::size_t i = 0; i < views->size(); ++i) {
    const LinearizedView& view = (*views)[i];
    Y[i].noalias() = view.information * view.transport;
    C.noalias() += view.transport.transpose() * Y[i];
  }
  if (!factorizeCholesky(&C)) return;
  for (Matrix6d& Y_i : Y) divideByTransposed(C, &Y_i);
  for (std::size_t j = 0; j < views->size(); ++j) {
    if ((*views)[j].position < 0) continue;  // the fixed ones come first
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
  const bool first_is_world = !markers.origin_marker && markers.anchors.empty();
  std::vector<std::vector<int>> neighbours(pattern.unknown.size());
  for (auto it = map.keyframes().begin(); it != map.keyframes().end();) {
    const KeyframeId id = it->first;
    PatternKeyframe keyframe{id, first_is_world && it == map.keyframes().begin(), {}};
    for (const MarkerDetection& detection : it->second.detections) {
      const int pose = pattern.poseOf(detection.id);
      if (pose < 0) continue;
      for (const int other : keyframe.seen) {
        neighbours[static_cast<std::size_t>(pose)].push_back(pattern.poseOf(other));
      }
      keyframe.seen.push_back(detection.id);
    }
    const auto n = static_cast<double>(keyframe.seen.size());
    if (!keyframe.seen.empty()) pattern.keyframes.push_back(std::move(keyframe));
    co_await budget->spend(kFindMarker * n * (n + 1.0));
    it = map.keyframes().upper_bound(id);
  }
  for (auto& of_one : neighbours) sortUnique(&of_one);
  const std::vector<std::vector<int>> pairs = neighbours;  // by pose: those before it

  BlockSystem system;
  (void)co_await system.arrange(std::move(neighbours), /*with_globals=*/false, budget);
  std::vector<LinearizedView> views;
  for (const PatternKeyframe& known : pattern.keyframes) {
    const auto n = static_cast<double>(known.seen.size());
    co_await budget->spend(kLinearizeView * n + kBlockProduct * n * (n + 1.0));
    const auto found = map.keyframes().find(known.id);
    if (found == map.keyframes().end()) continue;  // has been let go meanwhile
    views.clear();
    for (const MarkerDetection& detection : found->second.detections) {
      const MapMarker* const marker = map.findPosed(detection.id);
      const bool fixed = markers.origin_marker == detection.id;
      if (marker == nullptr) continue;
      if (!fixed && !std::ranges::binary_search(known.seen, detection.id)) continue;
      const Transform& T_w_c = found->second.T_w_c;
      const auto information =
          markerInformation(*marker->T_w_m, marker->size_m, detection, T_w_c, Matrix6d::Zero());
      if (!information) continue;
      const int position = fixed ? -1 : system.positionOf(pattern.poseOf(detection.id));
      views.push_back(
          {position, information->weighted, rigidTransport(marker->T_w_m->p - T_w_c.p)});
    }
    addKeyframe(&views, known.held, &system);
  }
  const double variance = residual_sigma * residual_sigma;
  for (std::size_t i = 0; i < pattern.unknown.size(); ++i) {
    const int position = system.positionOf(static_cast<int>(i));
    system.diagonal(position) += variance * priorInformation(pattern.unknown[i], markers);
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
    marginals.set(pattern.unknown[a], variance * system.diagonal(row));
  }
  for (std::size_t b = 0; b < pairs.size(); ++b) {
    co_await budget->spend(kTakeBlock * static_cast<double>(pairs[b].size()));
    const int of_b = system.positionOf(static_cast<int>(b));
    for (const int a : pairs[b]) {
      const int of_a = system.positionOf(a);
      const Matrix6d& block =
          system.block(system.place(std::max(of_a, of_b), std::min(of_a, of_b)));
      const Matrix6d rows_of_a = of_a > of_b ? block : Matrix6d(block.transpose());
      marginals.appendBetween(pattern.unknown[static_cast<std::size_t>(a)], pattern.unknown[b],
                              variance * rows_of_a);
    }
  }
  co_return marginals;
}

}  // namespace waymark::slam
