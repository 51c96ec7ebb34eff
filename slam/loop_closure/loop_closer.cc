#include "slam/loop_closure/loop_closer.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "slam/geometry/mean_transform.h"
#include "slam/geometry/robust.h"
#include "slam/geometry/two_hypotheses.h"
#include "slam/optimization/map_fit.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kViewPair = 0.003;
constexpr double kConnection = 0.012;
constexpr double kCorrectView = 0.07;
constexpr double kNoteView = 0.01;
constexpr double kCopyView = 0.01;
constexpr double kMovePose = 0.05;

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

// Every pair of cameras with a common marker, by how many they have.
Task<std::vector<std::vector<Connection>>> connections(const BundleProblem& problem,
                                                       Budget* budget) {
  const std::vector<std::vector<int>> by_marker = camerasByMarker(problem);
  co_await budget->spend(kNoteView * static_cast<double>(problem.observations.size()));
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
  co_return by_strength;
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

// The frame of a constraint is no camera: it follows one of those that see its markers.
void addFrameEdges(const BundleProblem& problem, PoseGraph* graph) {
  if (problem.constraints.empty()) return;
  const std::vector<std::vector<int>> by_marker = camerasByMarker(problem);
  int last = -1;  // they come frame by frame
  for (const auto& [frame, marker, relations] : problem.constraints) {
    if (frame == last || by_marker[at(marker)].empty()) continue;
    const int seer = by_marker[at(marker)].front();
    graph->edges.push_back(
        {seer, frame, graph->poses[at(seer)].inverse() * graph->poses[at(frame)]});
    last = frame;
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
  std::vector<Transform> moved;
  for (const int c : cameras) moved.push_back(after[at(c)] * before[at(c)].T.inverse() * T_w_m);
  return meanTransform(moved);
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
  KeyframeId newest = -1;  // of the map
  Subproblem part;
  double residual_sigma = 1.0;
  double huber = 0.0;  // in units of the corners' covariances
  double cost = 0.0;
};

Task<Before> prepare(const Map& map, SubproblemMembers members, const MarkerOptions& markers,
                     const LoopOptions& options, Budget* budget) {
  Before before;
  before.newest = map.keyframes().empty() ? -1 : map.keyframes().rbegin()->first;
  before.part = co_await buildSubproblem(map, std::move(members), markers, budget);
  const MapFit fit = co_await fitOf(before.part.problem, budget);
  before.residual_sigma = fit.residual_sigma;
  before.huber = fit.residual_sigma * options.optimization.huber;
  before.cost = co_await costOf(fit.squared, before.huber, budget);
  co_return before;
}

// The closing frame becomes the problem's last camera.
void addClosingFrame(const Subproblem& part, const LoopFrame& loop, const Transform& T_w_c,
                     BundleProblem* problem) {
  const int t = static_cast<int>(problem->cameras.size());
  problem->cameras.push_back({T_w_c, false});
  for (const MarkerDetection& detection : loop.frame.detections) {
    const int marker = part.markerIndex(detection.id);
    if (marker >= 0) problem->observations.push_back({t, marker, &detection});
  }
}

// The problem with its loop closed by the pose graph, before any optimization of corners.
Task<BundleProblem> correctedProblem(const Subproblem& part, PoseGraph graph, const LoopFrame& loop,
                                     const Transform& expected, const LoopOptions& options,
                                     Budget* budget) {
  const int t = static_cast<int>(graph.poses.size());
  const int c = closingCamera(part, loop.loop_markers);
  const int omega = referenceCamera(part, loop.reference);
  graph.edges.push_back({omega, t, graph.poses[at(omega)].inverse() * loop.frame.T_w_c});
  graph.edges.push_back({c, t, graph.poses[at(c)].inverse() * expected});
  graph.poses.push_back(loop.frame.T_w_c);
  graph.fixed = c;
  (void)co_await optimizePoseGraph(&graph, options.pose_graph, budget);

  co_await budget->spend(kCopyView * static_cast<double>(part.problem.observations.size()));
  BundleProblem corrected = part.problem;
  for (std::size_t i = 0; i < corrected.cameras.size(); ++i) {
    corrected.cameras[i].T = graph.poses[i];
  }
  const std::vector<std::vector<int>> by_marker = camerasByMarker(part.problem);
  co_await budget->spend(kNoteView * static_cast<double>(part.problem.observations.size()));
  (void)co_await correctMarkers(by_marker, part.problem.cameras, graph.poses, &corrected.markers,
                                budget);
  addClosingFrame(part, loop, graph.poses.back(), &corrected);
  // The graph held the closing camera.
  const Transform T_v_w = backToTheWorld(part.problem, corrected);
  co_await budget->spend(kMovePose * static_cast<double>(corrected.cameras.size()));
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

// corrected: with the closing frame as its last camera.
Task<Candidate> tryCandidate(const Before& before, BundleProblem corrected,
                             const LoopOptions& options, Budget* budget) {
  BundleAdjuster adjuster(std::move(corrected), options.optimization);
  (void)co_await adjuster.run(budget);
  const MapFit fit = co_await fitOf(adjuster.problem(), budget);

  Candidate candidate;
  candidate.correction = co_await correctionOf(before.part, adjuster, budget);
  candidate.T_w_closing = adjuster.problem().cameras.back().T;
  const double unit = before.residual_sigma * before.residual_sigma;
  const std::span<const double> squared(fit.squared);
  const auto old_views = squared.first(4 * before.part.problem.observations.size());
  const auto closing = squared.subspan(old_views.size());
  const double old_cost = co_await costOf(old_views, before.huber, budget);
  const double closing_cost = co_await costOf(closing, before.huber, budget);
  candidate.growth = (old_cost - before.cost) / unit;
  candidate.closing_error =
      closing_cost / unit / static_cast<double>(std::max(closing.size(), std::size_t{1}));
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

// The old views alone speak for the corrected map: they had been bent. They need neither another
// candidate beside it, nor a closing frame that fits: where that belongs is seen from the better
// map.
bool isMuchBetter(const Candidate& best, double allowed) { return best.growth < -allowed; }

ClosedLoop closedBy(Candidate candidate, KeyframeId newest, Keyframe frame) {
  ClosedLoop closed{std::move(candidate.correction), newest, std::move(frame), {}};
  closed.T_w_tracked = std::exchange(closed.closing.T_w_c, candidate.T_w_closing);
  return closed;
}

}  // namespace

std::string LoopOptions::invalidReason() const {
  return firstReason({
      firstUnmet({
          {isShare(min_joining_share), "the share of a loop's markers must be from 0 to 1"},
          {frames_between_attempts >= 0, "the frames between loop closures must not be negative"},
          {sure_views >= 1, "a marker that closes a loop needs at least 1 view"},
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
          {isPositive(max_cost_per_frame), "the cost of a loop closure must be positive"},
          {region_keyframes >= 1, "the region that is relaxed needs at least 1 keyframe"},
          {frames_before_relaxing >= 1, "at least 1 frame must leave time to relax the map"},
      }),
      pose_graph.invalidReason(),
      optimization.invalidReason(),
  });
}

Task<LoopOutcome> closeLoop(const Map& map, LoopFrame loop, const MarkerOptions& markers,
                            LoopOptions options, Budget* budget) {
  const Before before = co_await prepare(map, wholeMap(map), markers, options, budget);
  if (loop.expected.empty() || before.part.keyframes.empty()) co_return LoopRejection::kNoEvidence;
  const PoseGraph graph =
      co_await covisibilityGraph(before.part.problem, options.edges_per_keyframe, budget);
  const double allowed = allowedGrowth(before, loop.loop_markers.size(), options);
  std::optional<Candidate> best;
  std::optional<Candidate> other;
  for (const Transform& expected : loop.expected) {
    if (best && isMuchBetter(*best, allowed) && !rejectionOf(*best, {}, allowed, options)) break;
    BundleProblem corrected =
        co_await correctedProblem(before.part, graph, loop, expected, options, budget);
    Candidate candidate = co_await tryCandidate(before, std::move(corrected), options, budget);
    if (best && candidate.growth >= best->growth) {
      other = std::move(candidate);
    } else {
      other = std::move(best);
      best = std::move(candidate);
    }
  }
  if (const auto rejection = rejectionOf(*best, other, allowed, options)) {
    if (!isMuchBetter(*best, allowed)) co_return *rejection;
    co_return RelaxedMap{std::move(best->correction), before.newest};
  }
  co_return closedBy(std::move(*best), before.newest, std::move(loop.frame));
}

Task<LoopOutcome> relaxRegion(const Map& map, LoopFrame loop, const MarkerOptions& markers,
                              LoopOptions options, Budget* budget) {
  std::vector<KeyframeId> ends;
  if (map.keyframes().contains(loop.reference)) ends.push_back(loop.reference);
  for (const int marker : loop.loop_markers) {
    if (!map.viewsOf(marker).empty()) ends.push_back(map.viewsOf(marker).back());
  }
  SubproblemMembers region =
      co_await regionAround(map, std::move(ends), options.region_keyframes, budget);
  const Before before = co_await prepare(map, std::move(region), markers, options, budget);
  if (before.part.keyframes.empty()) co_return LoopRejection::kNoEvidence;
  BundleProblem problem = before.part.problem;
  addClosingFrame(before.part, loop, loop.frame.T_w_c, &problem);
  Candidate candidate = co_await tryCandidate(before, std::move(problem), options, budget);
  const double allowed = allowedGrowth(before, loop.loop_markers.size(), options);
  if (const auto rejection = rejectionOf(candidate, {}, allowed, options)) co_return *rejection;
  co_return closedBy(std::move(candidate), before.newest, std::move(loop.frame));
}

Task<LoopOutcome> relaxMap(const Map& map, const MarkerOptions& markers, LoopOptions options,
                           Budget* budget) {
  const KeyframeId newest = map.keyframes().empty() ? -1 : map.keyframes().rbegin()->first;
  RelaxedMap relaxed;
  relaxed.newest = newest;
  relaxed.correction =
      co_await optimizeSubproblem(map, wholeMap(map), markers, options.optimization, budget);
  if (relaxed.correction.summary.failed) co_return LoopRejection::kNoEvidence;
  co_return relaxed;
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
  const std::vector<std::vector<Connection>> by_strength = co_await connections(problem, budget);
  for (auto same = by_strength.rbegin(); same != by_strength.rend(); ++same) {
    for (const Connection& connection : *same) {
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
  }
  addLinkEdges(problem, &graph);
  addFrameEdges(problem, &graph);
  co_return graph;
}

}  // namespace waymark::slam
