#include "slam/loop_closure/loop_closer.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include <Eigen/Eigenvalues>

#include "slam/geometry/robust.h"
#include "slam/geometry/two_hypotheses.h"
#include "slam/optimization/map_fit.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kViewPair = 0.02;
constexpr double kConnection = 0.05;
constexpr double kCorrectView = 1.0;

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// Two cameras and how many markers they share.
struct Connection {
  int a = 0;
  int b = 0;
  int shared = 0;
};

std::vector<std::vector<int>> camerasByMarker(const BundleProblem& problem) {
  std::vector<std::vector<int>> cameras(problem.markers.size());
  for (const auto& observation : problem.observations) {
    cameras[at(observation.marker)].push_back(observation.camera);
  }
  return cameras;
}

// Every pair of cameras with a common marker, the strongest first.
Task<std::vector<Connection>> connections(const BundleProblem& problem, Budget* budget) {
  const std::vector<std::vector<int>> by_marker = camerasByMarker(problem);
  std::vector<std::vector<Connection>> by_strength;
  std::vector<int> shared(problem.cameras.size(), 0);
  std::vector<int> partners;
  auto observation = problem.observations.begin();  // they come camera by camera
  for (int a = 0; a < static_cast<int>(problem.cameras.size()); ++a) {
    partners.clear();
    std::size_t pairs = 0;
    for (; observation != problem.observations.end() && observation->camera == a; ++observation) {
      for (const int b : by_marker[at(observation->marker)]) {
        if (b > a && shared[at(b)]++ == 0) partners.push_back(b);
        ++pairs;
      }
    }
    std::ranges::sort(partners);
    for (const int b : partners) {
      const int strength = std::exchange(shared[at(b)], 0);
      if (at(strength) >= by_strength.size()) by_strength.resize(at(strength) + 1);
      by_strength[at(strength)].push_back({a, b, strength});
    }
    co_await budget->spend(kViewPair * static_cast<double>(pairs));
  }
  std::vector<Connection> list;
  for (auto same = by_strength.rbegin(); same != by_strength.rend(); ++same) {
    co_await budget->spend(kViewPair * static_cast<double>(same->size()));
    list.insert(list.end(), same->begin(), same->end());
  }
  co_return list;
}

// Kruskal's union-find.
class Forest {
 public:
  explicit Forest(std::size_t size) : parent_(size) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }

  // False when the two are connected already.
  bool join(int a, int b) {
    const int root_a = root(a);
    const int root_b = root(b);
    if (root_a == root_b) return false;
    parent_[static_cast<std::size_t>(root_a)] = root_b;
    return true;
  }

 private:
  int root(int i) {
    while (parent_[static_cast<std::size_t>(i)] != i) {
      int& parent = parent_[static_cast<std::size_t>(i)];
      parent = parent_[static_cast<std::size_t>(parent)];
      i = parent;
    }
    return i;
  }
  std::vector<int> parent_;
};

// From a camera with a link to one that sees the marker.
void addLinkEdges(const BundleProblem& problem, PoseGraph* graph) {
  // Beside one marker seen together, 1: what was carried is known less well, and bends first.
  constexpr double kLinkWeight = 0.1;
  if (problem.links.empty()) return;
  const std::vector<std::vector<int>> by_marker = camerasByMarker(problem);
  for (const auto& link : problem.links) {
    if (by_marker[at(link.marker)].empty()) continue;
    const int seer = by_marker[at(link.marker)].front();
    graph->edges.push_back({seer, link.camera,
                            graph->poses[at(seer)].inverse() * graph->poses[at(link.camera)],
                            kLinkWeight});
  }
}

// f^c: the oldest camera that sees a marker of L(t).
int closingCamera(const Subproblem& part, const std::vector<int>& loop_markers) {
  int oldest = static_cast<int>(part.keyframes.size()) - 1;
  for (const auto& observation : part.problem.observations) {
    const int id = part.markers[at(observation.marker)].id;
    if (std::ranges::find(loop_markers, id) == loop_markers.end()) continue;
    oldest = std::min(oldest, observation.camera);
  }
  return oldest;
}

// f^omega, or the newest camera where that takes no part.
int referenceCamera(const Subproblem& part, KeyframeId reference) {
  const auto found = std::ranges::lower_bound(part.keyframes, reference);
  const auto index = static_cast<int>(found - part.keyframes.begin());
  return std::min(index, static_cast<int>(part.keyframes.size()) - 1);
}

// Eq. 40: a marker moves as the cameras that see it moved, on average.
Transform correctedMarker(const Transform& T_w_m, std::span<const int> cameras,
                          const std::vector<BundleProblem::Pose>& before,
                          const std::vector<Transform>& after) {
  std::vector<Eigen::Matrix3d> rotations;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  for (const int c : cameras) {
    const Transform moved = after[at(c)] * before[at(c)].T.inverse() * T_w_m;
    rotations.push_back(moved.R);
    p += moved.p / static_cast<double>(cameras.size());
  }
  return {meanRotation(rotations), p};
}

// What takes the corrected poses back to where the world was: what fixes it stays where it is.
Transform backToTheWorld(const BundleProblem& before, const BundleProblem& after) {
  for (std::size_t m = 0; m < before.markers.size(); ++m) {
    if (before.markers[m].fixed) return before.markers[m].T * after.markers[m].T.inverse();
  }
  return before.cameras[0].T * after.cameras[0].T.inverse();
}

// What every candidate starts from, and is compared with.
struct Before {
  Subproblem part;
  std::vector<std::vector<int>> by_marker;  // cameras
  PoseGraph graph;
  double residual_sigma = 1.0;
  double huber = 0.0;  // in units of the corners' covariances
  double cost = 0.0;
};

Task<Before> prepare(const Map& map, const MarkerOptions& markers, const LoopOptions& options,
                     Budget* budget) {
  Before before;
  before.part = co_await buildSubproblem(map, wholeMap(map), markers, budget);
  const MapFit fit = co_await fitOf(before.part.problem, budget);
  before.residual_sigma = fit.residual_sigma;
  before.huber = fit.residual_sigma * options.optimization.huber;
  before.cost = costOf(fit.squared, before.huber);
  before.by_marker = camerasByMarker(before.part.problem);
  before.graph =
      co_await covisibilityGraph(before.part.problem, options.edges_per_keyframe, budget);
  co_return before;
}

// The problem with its loop closed by the pose graph, before any optimization of corners. The
// closing frame is its last camera.
Task<BundleProblem> correctedProblem(const Before& before, const LoopFrame& loop,
                                     const Transform& expected, const LoopOptions& options,
                                     Budget* budget) {
  const Subproblem& part = before.part;
  PoseGraph graph = before.graph;
  const int t = static_cast<int>(graph.poses.size());
  const int c = closingCamera(part, loop.loop_markers);
  const int omega = referenceCamera(part, loop.reference);
  graph.edges.push_back({omega, t, graph.poses[at(omega)].inverse() * loop.frame.T_w_c});
  graph.edges.push_back({c, t, graph.poses[at(c)].inverse() * expected});
  graph.poses.push_back(loop.frame.T_w_c);
  graph.fixed = c;
  (void)co_await optimizePoseGraph(&graph, options.pose_graph, budget);

  BundleProblem corrected = part.problem;
  for (std::size_t i = 0; i < corrected.cameras.size(); ++i) {
    corrected.cameras[i].T = graph.poses[i];
  }
  (void)co_await correctMarkers(before.by_marker, part.problem.cameras, graph.poses,
                                &corrected.markers, budget);
  corrected.cameras.push_back({graph.poses.back(), false});
  for (const MarkerDetection& detection : loop.frame.detections) {
    const int marker = part.markerIndex(detection.id);
    if (marker >= 0) corrected.observations.push_back({t, marker, &detection});
  }
  // The graph held the closing camera.
  const Transform T_v_w = backToTheWorld(part.problem, corrected);
  for (auto& camera : corrected.cameras) camera.T = T_v_w * camera.T;
  for (auto& marker : corrected.markers) marker.T = T_v_w * marker.T;
  for (std::size_t i = 0; i < part.problem.cameras.size(); ++i) {
    if (part.problem.cameras[i].fixed) corrected.cameras[i].T = part.problem.cameras[i].T;
  }
  for (std::size_t m = 0; m < part.problem.markers.size(); ++m) {
    if (part.problem.markers[m].fixed) corrected.markers[m].T = part.problem.markers[m].T;
  }
  co_return corrected;
}

struct Candidate {
  MapCorrection correction;
  Transform T_w_closing;
  double growth = 0.0;         // of the old views' cost, in units of the noise squared
  double closing_error = 0.0;  // of the closing frame, likewise
};

Task<Candidate> tryCandidate(const Before& before, const LoopFrame& loop, const Transform& expected,
                             const LoopOptions& options, Budget* budget) {
  BundleProblem corrected = co_await correctedProblem(before, loop, expected, options, budget);
  BundleAdjuster adjuster(std::move(corrected), options.optimization);
  (void)co_await adjuster.run(budget);
  const MapFit fit = co_await fitOf(adjuster.problem(), budget);

  Candidate candidate;
  candidate.correction = correctionOf(before.part, adjuster);
  candidate.T_w_closing = adjuster.problem().cameras.back().T;
  const double unit = before.residual_sigma * before.residual_sigma;
  const std::span<const double> squared(fit.squared);
  const auto old_views = squared.first(4 * before.part.problem.observations.size());
  const auto closing = squared.subspan(old_views.size());
  candidate.growth = (costOf(old_views, before.huber) - before.cost) / unit;
  candidate.closing_error = costOf(closing, before.huber) / unit /
                            static_cast<double>(std::max(closing.size(), std::size_t{1}));
  co_return candidate;
}

// Of the old views' cost, in units of the noise squared.
double allowedGrowth(const Before& before, std::size_t loop_markers, const LoopOptions& options) {
  const double variance = before.residual_sigma * before.residual_sigma;
  const double cost = before.cost / variance;
  const double of_model_errors = cost * (1.0 - 1.0 / variance);
  return static_cast<double>(loop_markers) *
             (options.max_growth + options.max_growth_share * cost) +
         options.max_growth_of_model_errors * of_model_errors;
}

std::optional<LoopRejection> rejectionOf(const Candidate& best,
                                         const std::optional<Candidate>& other, double allowed,
                                         const LoopOptions& options) {
  if (!(best.growth <= allowed) || !(best.closing_error <= options.max_closing_error)) {
    return LoopRejection::kContradicted;
  }
  if (!other || !isAnotherPose(other->T_w_closing, best.T_w_closing, options.other_rotation_rad)) {
    return std::nullopt;
  }
  const double floor = options.ambiguity_floor;
  const bool much_worse = std::max(other->growth, 0.0) + floor >=
                          options.ambiguity_ratio * (std::max(best.growth, 0.0) + floor);
  return much_worse ? std::nullopt : std::optional(LoopRejection::kAmbiguous);
}

}  // namespace

std::string LoopOptions::invalidReason() const {
  return firstReason({
      firstUnmet({
          {isShare(min_joining_share), "the share of a loop's markers must be from 0 to 1"},
          {frames_between_attempts >= 0, "the frames between loop closures must not be negative"},
          {min_witnesses >= 1, "a marker that disagrees needs at least 1 witness"},
          {edges_per_keyframe >= 0, "the edges of a keyframe must not be negative"},
          {isNotNegative(max_growth) && isNotNegative(max_growth_share) &&
               isNotNegative(max_growth_of_model_errors),
           "the growth that a loop closure may cause must not be negative"},
          {isPositive(max_closing_error), "the error of a closing frame must be positive"},
          {ambiguity_ratio >= 1.0, "ambiguity ratios must be at least 1"},
          {isNotNegative(other_rotation_rad), "the turn to another pose must not be negative"},
          {isNotNegative(ambiguity_floor), "the floor of a loop's ambiguity must not be negative"},
          {isNotNegative(cost_per_view), "the cost of a loop's view must not be negative"},
          {isPositive(frames_to_close), "the frames of a loop closure must be positive"},
      }),
      pose_graph.invalidReason(),
      optimization.invalidReason(),
  });
}

Task<LoopOutcome> closeLoop(const Map& map, LoopFrame loop, const MarkerOptions& markers,
                            LoopOptions options, Budget* budget) {
  const Before before = co_await prepare(map, markers, options, budget);
  if (loop.expected.empty() || before.part.keyframes.empty()) co_return LoopRejection::kNoEvidence;
  std::optional<Candidate> best;
  std::optional<Candidate> other;
  for (const Transform& expected : loop.expected) {
    Candidate candidate = co_await tryCandidate(before, loop, expected, options, budget);
    if (best && candidate.growth >= best->growth) {
      other = std::move(candidate);
    } else {
      other = std::move(best);
      best = std::move(candidate);
    }
  }
  const double allowed = allowedGrowth(before, loop.loop_markers.size(), options);
  if (const auto rejection = rejectionOf(*best, other, allowed, options)) co_return *rejection;
  ClosedLoop closed{std::move(best->correction), std::move(loop.frame), {}};
  closed.T_w_tracked = std::exchange(closed.closing.T_w_c, best->T_w_closing);
  co_return closed;
}

std::optional<KeyframeId> adopt(const ClosedLoop& loop, Map* map) {
  if (loop.correction.epoch != map->epoch()) return std::nullopt;
  // What is newer than the correction moves with the closing frame; a marker's second hypothesis
  // moves with its first.
  const Transform T_new_old = loop.closing.T_w_c * loop.T_w_tracked.inverse();
  const KeyframeId newest = loop.correction.keyframes.back().id;
  for (auto it = map->keyframes().upper_bound(newest); it != map->keyframes().end(); ++it) {
    map->setKeyframePose(it->first, T_new_old * it->second.T_w_c);
  }
  std::vector<std::pair<int, Transform>> firsts;
  for (const auto& [id, marker] : map->markers()) {
    if (!marker.T_w_m) continue;
    map->place(id, T_new_old * *marker.T_w_m, marker.other_T_w_m, marker.covariance);
    if (marker.other_T_w_m) firsts.emplace_back(id, *marker.T_w_m);
  }
  (void)apply(loop.correction, map);
  for (const auto& [id, T_w_m] : firsts) {
    const MapMarker& marker = *map->findPosed(id);
    map->place(id, *marker.T_w_m, *marker.T_w_m * T_w_m.inverse() * T_new_old * *marker.other_T_w_m,
               marker.covariance);
  }
  map->beginEpoch();
  Keyframe closing = loop.closing;
  closing.detections.change([&](auto* detections) {
    std::erase_if(*detections,
                  [&](const MarkerDetection& d) { return map->find(d.id) == nullptr; });
  });
  return map->addKeyframe(std::move(closing));
}

Task<Done> correctMarkers(const std::vector<std::vector<int>>& by_marker,
                          const std::vector<BundleProblem::Pose>& before,
                          const std::vector<Transform>& after,
                          std::vector<BundleProblem::Pose>* markers, Budget* budget) {
  for (std::size_t m = 0; m < markers->size(); ++m) {
    const std::vector<int>& cameras = by_marker[m];
    co_await budget->spend(kCorrectView * static_cast<double>(cameras.size()));
    if (cameras.empty()) continue;
    Transform& T_w_m = (*markers)[m].T;
    T_w_m = correctedMarker(T_w_m, cameras, before, after);
  }
  co_return Done{};
}

Task<PoseGraph> covisibilityGraph(const BundleProblem& problem, int edges_per_keyframe,
                                  Budget* budget) {
  PoseGraph graph;
  for (const auto& camera : problem.cameras) graph.poses.push_back(camera.T);
  Forest forest(graph.poses.size());
  std::vector<int> degree(graph.poses.size(), 0);
  const std::vector<Connection> strongest_first = co_await connections(problem, budget);
  for (const Connection& connection : strongest_first) {
    co_await budget->spend(kConnection);
    const std::size_t a = at(connection.a);
    const std::size_t b = at(connection.b);
    const bool in_tree = forest.join(connection.a, connection.b);
    if (!in_tree && degree[a] >= edges_per_keyframe && degree[b] >= edges_per_keyframe) continue;
    ++degree[a];
    ++degree[b];
    graph.edges.push_back({connection.a, connection.b, graph.poses[a].inverse() * graph.poses[b],
                           static_cast<double>(connection.shared)});
  }
  addLinkEdges(problem, &graph);
  co_return graph;
}

Eigen::Matrix3d meanRotation(std::span<const Eigen::Matrix3d> rotations) {
  // The largest eigenvector of the sum of q q^T: the sign of a quaternion does not matter to it.
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Eigen::Matrix3d& R : rotations) {
    const Eigen::Vector4d q = Eigen::Quaterniond(R).coeffs();
    sum += q * q.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(sum);
  const Eigen::Vector4d q = solver.eigenvectors().col(3);
  return Eigen::Quaterniond(q).normalized().toRotationMatrix();
}

}  // namespace waymark::slam
