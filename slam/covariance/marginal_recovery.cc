#include "slam/covariance/marginal_recovery.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "base/distinct_indices.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/map/world_reference.h"
#include "slam/optimization/block_system.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kFindMarker = 0.1;
constexpr double kNotePairOfView = 0.006;
constexpr double kSortPair = 0.003;
constexpr double kSetMarker = 0.4;
constexpr double kTestConstrained = 3.0;
constexpr double kLookAtKept = 0.03;  // a marker of it
constexpr double kLinearizeView = 0.6;
constexpr double kBlockProduct = 0.08;
constexpr double kAddBlock = 0.025;
constexpr double kTakeBlock = 0.5;
constexpr double kTakeStep = 0.02;
constexpr double kLinearizeByCamera = 0.1;  // a view, by one parameter

// Where nothing else says where a marker is, this does: standard deviations so large that they
// show, and small enough to keep the system regular.
constexpr double kUnknown_m = 100.0;
constexpr double kUnknown_rad = 10.0;

// The keyframe and the unknown markers it sees: what the elimination's pattern was made for. (There
// are thousands, and no frame has the time to let go of memory of each: they own none.)
struct PatternKeyframe {
  KeyframeId id = -1;
  bool held = false;
  std::size_t first_seen = 0;  // in Pattern::seen
  std::size_t seen_count = 0;
  const KeyframeInformation* kept = nullptr;  // from an earlier recovery, or to be linearized
};

struct Pattern {
  std::vector<int> unknown;               // ids, ascending: the poses of the system
  std::vector<LinearizedMarker> markers;  // by pose of the system
  std::vector<int> given;                 // ids: fixed, or seen by nobody
  std::optional<int> origin;              // the marker that is fixed, where it has a pose
  LinearizedMarker of_origin;
  std::vector<PatternKeyframe> keyframes;
  std::vector<int> seen;  // poses of the system, ascending within a keyframe

  [[nodiscard]] std::span<const int> seenBy(const PatternKeyframe& keyframe) const {
    return std::span(seen).subspan(keyframe.first_seen, keyframe.seen_count);
  }

  // -1 for a marker that is no unknown.
  [[nodiscard]] int poseOf(int id) const {
    const auto found = std::ranges::lower_bound(unknown, id);
    return found == unknown.end() || *found != id ? -1 : static_cast<int>(found - unknown.begin());
  }
  [[nodiscard]] const LinearizedMarker* find(int id) const {
    if (origin == id) return &of_origin;
    const int pose = poseOf(id);
    return pose < 0 ? nullptr : &markers[static_cast<std::size_t>(pose)];
  }
};

Task<Pattern> startPattern(const Map& map, const MarkerOptions& markers,
                           LinearizationPoints* points, Budget* budget) {
  Pattern pattern;
  for (auto it = map.markers().begin(); it != map.markers().end();) {
    const auto& [id, marker] = *it;
    if (marker.T_w_m) {
      const bool fixed = markers.origin_marker == id;
      const bool nobody_says = map.viewsOf(id).empty() && map.linkedFrom(id).empty();
      const bool given = fixed || nobody_says;
      (given ? pattern.given : pattern.unknown).push_back(id);
      const LinearizedMarker linearized{points->follow(id, *marker.T_w_m, marker.size_m), fixed};
      if (!given) pattern.markers.push_back(linearized);
      if (fixed) {
        pattern.origin = id;
        pattern.of_origin = linearized;
      }
    }
    const int seen = id;
    co_await budget->spend(kFindMarker);
    it = map.markers().upper_bound(seen);
  }
  co_return pattern;
}

// What is kept of it, if anything; what it sees goes to the pattern.
PatternKeyframe lookAt(const Keyframe& keyframe, bool held, double residual_sigma,
                       const CameraUncertainty& camera, const KeptInformation& kept,
                       Pattern* pattern) {
  PatternKeyframe result{keyframe.id, held, pattern->seen.size(), 0, kept.find(keyframe.id)};
  const MarkerLookup lookup = [&](int id) { return pattern->find(id); };
  if (result.kept != nullptr &&
      !isAsBefore(*result.kept, keyframe, held, residual_sigma, camera, lookup)) {
    result.kept = nullptr;
  }
  const auto note = [&](const std::vector<int>& unknown) {
    for (const int id : unknown) pattern->seen.push_back(pattern->poseOf(id));
    result.seen_count = unknown.size();
  };
  if (result.kept != nullptr) {
    note(result.kept->unknown);
  } else {
    note(beginInformation(keyframe, held, residual_sigma, camera, lookup).unknown);
  }
  return result;
}

// Of a keyframe that nothing is kept of. Empty where it sees other markers by now than the pattern
// was made for.
std::optional<KeyframeInformation> informationOf(const Map& map, const PatternKeyframe& known,
                                                 double residual_sigma,
                                                 const CameraUncertainty& camera,
                                                 const Pattern& pattern) {
  const auto found = map.keyframes().find(known.id);
  if (found == map.keyframes().end()) return std::nullopt;  // has been let go meanwhile
  const MarkerLookup lookup = [&](int id) { return pattern.find(id); };
  KeyframeInformation information =
      beginInformation(found->second, known.held, residual_sigma, camera, lookup);
  const auto poseOf = [&](int id) { return pattern.poseOf(id); };
  if (!std::ranges::equal(information.unknown, pattern.seenBy(known), {}, poseOf)) {
    return std::nullopt;
  }
  linearize(map, found->second, camera, lookup, &information);
  return information;
}

// What is known of a marker's place but from the keyframes. moved: from the point about which the
// system is linear to where the marker is. variance: that of the residuals, in whose units the
// system is.
void addPriors(int id, const Transform& point, const Vector6d& moved, const MarkerOptions& markers,
               double variance, int position, BlockSystem* system) {
  const Matrix6d hardly_known = variance * independentInformation(kUnknown_m, kUnknown_rad);
  system->diagonal(position) += hardly_known;
  system->right(position) += hardly_known * moved;
  for (const Anchor& anchor : markers.anchors) {
    if (anchor.id != id) continue;
    const Matrix6d information =
        variance * independentInformation(anchor.sigma_m, anchor.sigma_rad);
    system->diagonal(position) += information;
    system->right(position) += information * point.localCoordinates(anchor.T_w_m);
  }
}

// What the camera's parameters add to the system: a right side for each, and what it comes to.
class CameraSides {
 public:
  CameraSides(CameraUncertainty::Unknown unknown, std::size_t poses)
      : parameters(unknown), sides_(poses * static_cast<std::size_t>(unknown.count)) {
    std::ranges::fill(sides_, Vector6d::Zero());
  }
  // By parameter.
  [[nodiscard]] std::span<Vector6d> of(int pose) {
    const auto count = static_cast<std::size_t>(parameters.count);
    return std::span(sides_).subspan(static_cast<std::size_t>(pose) * count, count);
  }
  [[nodiscard]] PoseGlobalMatrix matrixOf(int pose) {
    PoseGlobalMatrix result = PoseGlobalMatrix::Zero();
    int column = parameters.first;
    for (const Vector6d& side : of(pose)) result.col(column++) = side;
    return result;
  }

  const CameraUncertainty::Unknown parameters;

 private:
  std::vector<Vector6d> sides_;
};

// seen: the poses of the system that the information is of, in its order.
void addKeyframe(const KeyframeInformation& information, std::span<const int> seen,
                 CameraSides* by_camera) {
  auto side = information.by_camera.begin();
  for (const int pose : seen) {
    for (Vector6d& sum : by_camera->of(pose)) sum += *side++;
  }
}

void addKeyframe(const KeyframeInformation& information, std::span<const int> seen,
                 BlockSystem* system) {
  auto block = information.blocks.begin();
  for (std::size_t j = 0; j < seen.size(); ++j) {
    const int column = system->positionOf(seen[j]);
    system->right(column) += information.right[j];
    system->diagonal(column) += *block++;
    for (std::size_t i = j + 1; i < seen.size(); ++i) {
      const int row = system->positionOf(seen[i]);
      Matrix6d& sum = system->block(system->place(std::max(row, column), std::min(row, column)));
      if (row > column) {
        sum += *block++;
      } else {
        sum += (block++)->transpose();
      }
    }
  }
}

// The right sides of one parameter become what the poses move by, if it grows by 1. After solve().
Task<bool> solveByCamera(int parameter, CameraSides* by_camera, BlockSystem* system,
                         Budget* budget) {
  const auto p = static_cast<std::size_t>(parameter);
  for (int pose = 0; pose < system->poses(); ++pose) {
    co_await budget->spend(kTakeStep);
    system->right(system->positionOf(pose)) = by_camera->of(pose)[p];
  }
  if (!co_await system->solveAgain(budget)) co_return false;
  for (int pose = 0; pose < system->poses(); ++pose) {
    co_await budget->spend(kTakeStep);
    by_camera->of(pose)[p] = system->right(system->positionOf(pose));
  }
  co_return true;
}

}  // namespace

Task<MapMarginals> recoverMarginals(const Map& map, const MarkerOptions& markers,
                                    CameraUncertainty camera, double residual_sigma, Budget* budget,
                                    KeptInformation* kept,
                                    std::vector<ConstraintResidual>* constraints) {
  KeptInformation nothing(0);
  if (kept == nullptr) kept = &nothing;
  Pattern pattern = co_await startPattern(map, markers, &kept->points(), budget);
  const bool first_is_world = firstKeyframeIsWorld(map, markers);
  std::vector<std::vector<int>> neighbours(pattern.unknown.size());
  KeyframeId next = 0;
  for (auto it = map.keyframes().begin(); it != map.keyframes().end();) {
    const KeyframeId id = it->first;
    kept->forgetBetween(next, id);
    next = id + 1;
    const bool held = first_is_world && it == map.keyframes().begin();
    const PatternKeyframe keyframe =
        lookAt(it->second, held, residual_sigma, camera, *kept, &pattern);
    const std::span<const int> seen = pattern.seenBy(keyframe);
    for (std::size_t i = 0; i < seen.size(); ++i) {
      auto& before = neighbours[static_cast<std::size_t>(seen[i])];
      before.insert(before.end(), seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(i));
    }
    const auto n = static_cast<double>(seen.size());
    const double look = keyframe.kept != nullptr ? kLookAtKept : kFindMarker;
    if (!seen.empty()) pattern.keyframes.push_back(keyframe);
    co_await budget->spend(n * (look + kNotePairOfView * n));
    it = map.keyframes().upper_bound(id);
  }
  kept->forgetBetween(next, std::numeric_limits<KeyframeId>::max());
  std::vector<std::vector<int>> pairs;  // by pose: those before it
  pairs.reserve(neighbours.size());
  DistinctIndices distinct(neighbours.size());
  for (auto& of_one : neighbours) {
    co_await budget->spend(kFindMarker + kSortPair * static_cast<double>(of_one.size()));
    distinct.sort(&of_one);
    pairs.push_back(of_one);
  }

  if (!markers.constraints.empty()) {
    co_await budget->spend(kTestConstrained * static_cast<double>(pattern.unknown.size()));
  }
  ConstraintInformation information(map, markers, [&](int id, const Transform& T_w_m) {
    const LinearizedMarker* const linearized = pattern.find(id);
    return ConstrainedUnknown{pattern.poseOf(id),
                              linearized == nullptr ? T_w_m : linearized->point.T_w_m};
  });
  information.appendPoses(&neighbours);

  CameraSides by_camera(camera.unknown(), neighbours.size());
  BlockSystem system;
  (void)co_await system.arrange(std::move(neighbours), /*with_globals=*/false, budget);
  for (PatternKeyframe& known : pattern.keyframes) {
    const auto n = static_cast<double>(known.seen_count);
    co_await budget->spend(0.5 * kAddBlock * n * (n + 1.0));
    std::optional<KeyframeInformation> anew;
    if (known.kept == nullptr) {
      co_await budget->spend((kFindMarker + kLinearizeView) * n + kBlockProduct * n * (n + 1.0) +
                             kLinearizeByCamera * n * camera.unknown().count);
      anew = informationOf(map, known, residual_sigma, camera, pattern);
      if (!anew) continue;
      known.kept = kept->keep(known.id, &*anew);
    }
    const KeyframeInformation& information = known.kept != nullptr ? *known.kept : *anew;
    addKeyframe(information, pattern.seenBy(known), &system);
    addKeyframe(information, pattern.seenBy(known), &by_camera);
  }
  const double variance = residual_sigma * residual_sigma;
  std::vector<Vector6d> moved(pattern.unknown.size(), Vector6d::Zero());
  for (std::size_t i = 0; i < pattern.unknown.size(); ++i) {
    co_await budget->spend(kSetMarker);
    const int id = pattern.unknown[i];
    const MapMarker* const marker = map.findPosed(id);
    const Transform& point = pattern.markers[i].point.T_w_m;
    if (marker != nullptr) moved[i] = point.localCoordinates(*marker->T_w_m);
    addPriors(id, point, moved[i], markers, variance, system.positionOf(static_cast<int>(i)),
              &system);
  }
  information.addTo(variance, &system);

  MapMarginals marginals;
  for (const int id : pattern.given) {
    const MapMarker* const marker = map.findPosed(id);
    if (marker == nullptr) continue;
    marginals.set(id,
                  markers.origin_marker == id ? Matrix6d(Matrix6d::Zero()) : marker->covariance);
  }
  if (!co_await system.solve(budget)) co_return MapMarginals{};
  std::vector<Vector6d> steps(pattern.unknown.size());
  for (std::size_t a = 0; a < pattern.unknown.size(); ++a) {
    co_await budget->spend(kTakeStep);
    // From where the marker is, no longer from its point.
    steps[a] = system.right(system.positionOf(static_cast<int>(a))) - moved[a];
  }
  if (constraints != nullptr) information.solved(&system);
  for (int p = 0; p < by_camera.parameters.count; ++p) {
    if (!co_await solveByCamera(p, &by_camera, &system, budget)) co_return MapMarginals{};
  }
  (void)co_await system.invert(budget);
  if (constraints != nullptr) *constraints = information.residuals(variance, &system);
  for (std::size_t a = 0; a < pattern.unknown.size(); ++a) {
    co_await budget->spend(kSetMarker);
    const int row = system.positionOf(static_cast<int>(a));
    marginals.set(pattern.unknown[a],
                  variance * system.diagonal(row) + steps[a] * steps[a].transpose());
    if (by_camera.parameters.count > 0) {
      marginals.setByCamera(pattern.unknown[a], by_camera.matrixOf(static_cast<int>(a)));
    }
  }
  for (std::size_t b = 0; b < pairs.size(); ++b) {
    co_await budget->spend(kTakeBlock * static_cast<double>(pairs[b].size()));
    const int of_b = system.positionOf(static_cast<int>(b));
    for (const int a : pairs[b]) {
      const int of_a = system.positionOf(a);
      const Matrix6d& block =
          system.block(system.place(std::max(of_a, of_b), std::min(of_a, of_b)));
      const Matrix6d rows_of_a = of_a > of_b ? block : Matrix6d(block.transpose());
      const Matrix6d of_steps = steps[static_cast<std::size_t>(a)] * steps[b].transpose();
      marginals.appendBetween(pattern.unknown[static_cast<std::size_t>(a)], pattern.unknown[b],
                              variance * rows_of_a + of_steps);
    }
  }
  co_return marginals;
}

}  // namespace waymark::slam
