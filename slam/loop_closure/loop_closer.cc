#include "slam/loop_closure/loop_closer.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <utility>

#include <Eigen/Eigenvalues>

#include "slam/optimisation/map_optimiser.h"

namespace waymark::slam {
namespace {

// Two keyframes and how many markers they share.
struct Connection {
  int a = 0;
  int b = 0;
  int shared = 0;
};

// Every pair of keyframes with a common marker, the strongest first.
std::vector<Connection> connections(const Map& map, const std::map<KeyframeId, int>& index) {
  std::map<std::pair<int, int>, int> shared;
  for (const auto& [id, marker] : map.markers()) {
    const auto views = map.viewsOf(id);
    for (std::size_t i = 0; i < views.size(); ++i) {
      for (std::size_t j = i + 1; j < views.size(); ++j) {
        ++shared[{index.at(views[i]), index.at(views[j])}];
      }
    }
  }
  std::vector<Connection> list;
  list.reserve(shared.size());
  for (const auto& [pair, count] : shared) list.push_back({pair.first, pair.second, count});
  std::stable_sort(list.begin(), list.end(),
                   [](const Connection& x, const Connection& y) { return x.shared > y.shared; });
  return list;
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

// f^c: the oldest keyframe in which a marker of L(t) is seen.
KeyframeId closingKeyframe(const Map& map, const std::vector<int>& loop_markers) {
  KeyframeId oldest = map.keyframes().rbegin()->first;
  for (const int id : loop_markers) {
    const auto views = map.viewsOf(id);
    if (!views.empty()) oldest = std::min(oldest, views.front());
  }
  return oldest;
}

// Eq. 40: a marker moves as the keyframes that see it moved, on average.
Transform correctedMarker(const Transform& T_w_m, std::span<const KeyframeId> views,
                          const Map& before, const Map& after) {
  std::vector<Eigen::Matrix3d> rotations;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  for (const KeyframeId id : views) {
    const Transform moved =
        after.keyframes().at(id).T_w_c * before.keyframes().at(id).T_w_c.inverse() * T_w_m;
    rotations.push_back(moved.R);
    p += moved.p / static_cast<double>(views.size());
  }
  return {meanRotation(rotations), p};
}

// The map with its loop closed by the pose graph, before any optimisation of corners.
Map correctedMap(const Map& map, const LoopFrame& loop, const Transform& expected,
                 const LoopOptions& options) {
  std::vector<KeyframeId> ids;
  PoseGraph graph = covisibilityGraph(map, options.edges_per_keyframe, &ids);
  const auto indexOf = [&](KeyframeId id) {
    return static_cast<int>(std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
  };
  const int t = static_cast<int>(graph.poses.size());
  const int c = indexOf(closingKeyframe(map, loop.loop_markers));
  const int omega = indexOf(loop.reference);
  const Transform& T_w_ref = graph.poses[static_cast<std::size_t>(omega)];
  const Transform& T_w_closing = graph.poses[static_cast<std::size_t>(c)];
  graph.edges.push_back({omega, t, T_w_ref.inverse() * loop.frame.T_w_c});
  graph.edges.push_back({c, t, T_w_closing.inverse() * expected});
  graph.poses.push_back(loop.frame.T_w_c);
  graph.fixed = c;
  (void)inOneGo([&](Allowance* a) { return optimisePoseGraph(&graph, options.pose_graph, a); });

  Map corrected = map;
  for (std::size_t i = 0; i < ids.size(); ++i) corrected.keyframePose(ids[i]) = graph.poses[i];
  for (const auto& [id, marker] : map.markers()) {
    const auto views = map.viewsOf(id);
    if (views.empty() || !marker.T_w_m) continue;
    corrected.marker(id).T_w_m = correctedMarker(*marker.T_w_m, views, map, corrected);
    if (marker.other_T_w_m) {
      corrected.marker(id).other_T_w_m =
          correctedMarker(*marker.other_T_w_m, views, map, corrected);
    }
  }
  Keyframe closing = loop.frame;
  closing.T_w_c = graph.poses.back();
  (void)corrected.addKeyframe(std::move(closing));
  // The graph held the closing keyframe; the world's origin is the first one.
  const auto first = map.keyframes().begin();
  corrected.moveWorld(first->second.T_w_c * corrected.keyframes().at(first->first).T_w_c.inverse());
  return corrected;
}

// The map before its correction, as the corrected ones are compared with it.
struct Reference {
  std::vector<KeyframeId> keyframes;
  double noise = 1.0;
  double huber = 0.0;  // in units of the corners' covariances
  double cost = 0.0;
};

Reference referenceOf(const Map& map, const BundleOptions& options) {
  Reference reference;
  for (const auto& [id, keyframe] : map.keyframes()) reference.keyframes.push_back(id);
  const MapFit fit = fitOf(map);
  reference.noise = fit.noise;
  reference.huber = fit.noise * options.huber;
  reference.cost = fit.cost(reference.huber);
  return reference;
}

struct Candidate {
  ClosedLoop closed;
  double growth = 0.0;         // of the old views' cost, in units of the noise squared
  double closing_error = 0.0;  // of the closing frame, likewise
};

Candidate tryCandidate(const Map& map, const LoopFrame& loop, const Transform& expected,
                       const Reference& before, const MarkerOptions& markers,
                       const LoopOptions& options) {
  Candidate candidate{{correctedMap(map, loop, expected, options), -1}, 0.0, 0.0};
  Map& corrected = candidate.closed.map;
  candidate.closed.keyframe = corrected.keyframes().rbegin()->first;
  (void)optimiseGlobally(&corrected, markers, options.optimisation);

  const double unit = before.noise * before.noise;
  const KeyframeId closing[] = {candidate.closed.keyframe};
  candidate.closing_error = fitOf(corrected, closing).meanCost(before.huber) / unit;
  const double cost = fitOf(corrected, before.keyframes).cost(before.huber);
  candidate.growth = (cost - before.cost) / unit;
  return candidate;
}

// Of the old views' cost, in units of the noise squared.
double allowedGrowth(const Reference& before, std::size_t loop_markers,
                     const LoopOptions& options) {
  const double variance = before.noise * before.noise;
  const double cost = before.cost / variance;
  const double of_model_errors = cost * (1.0 - 1.0 / variance);
  return static_cast<double>(loop_markers) *
             (options.max_growth + options.max_growth_share * cost) +
         options.max_growth_of_model_errors * of_model_errors;
}

// The optimisation may have led the second candidate to the first one's map: no contradiction.
bool isAnother(const ClosedLoop& a, const ClosedLoop& b) {
  constexpr double kOtherRotation = 0.05;  // radians, of the closing frame
  return rotationDistance(a.map.keyframes().at(a.keyframe).T_w_c.R,
                          b.map.keyframes().at(b.keyframe).T_w_c.R) > kOtherRotation;
}

}  // namespace

std::variant<ClosedLoop, LoopRefusal> closeLoop(const Map& map, const LoopFrame& loop,
                                                const MarkerOptions& markers,
                                                const LoopOptions& options) {
  if (loop.expected.empty()) return LoopRefusal::kNoEvidence;
  const Reference before = referenceOf(map, options.optimisation);
  const double allowed = allowedGrowth(before, loop.loop_markers.size(), options);
  std::optional<Candidate> best;
  std::optional<Candidate> other;
  for (const Transform& expected : loop.expected) {
    Candidate candidate = tryCandidate(map, loop, expected, before, markers, options);
    if (best && candidate.growth >= best->growth) {
      other = std::move(candidate);
    } else {
      other = std::move(best);
      best = std::move(candidate);
    }
  }
  if (!best || !(best->growth <= allowed) ||
      !(best->closing_error <= options.worst_closing_error)) {
    return LoopRefusal::kContradicted;
  }
  if (other && isAnother(other->closed, best->closed)) {
    // Odds, not a quotient of small numbers: both growths above what noise alone makes of them.
    const double floor = 8.0;
    if (std::max(other->growth, 0.0) + floor <
        options.ambiguity_ratio * (std::max(best->growth, 0.0) + floor)) {
      return LoopRefusal::kAmbiguous;
    }
  }
  return std::move(best->closed);
}

PoseGraph covisibilityGraph(const Map& map, int edges_per_keyframe, std::vector<KeyframeId>* ids) {
  PoseGraph graph;
  std::map<KeyframeId, int> index;
  ids->clear();
  for (const auto& [id, keyframe] : map.keyframes()) {
    index[id] = static_cast<int>(ids->size());
    ids->push_back(id);
    graph.poses.push_back(keyframe.T_w_c);
  }
  Forest forest(ids->size());
  std::vector<int> degree(ids->size(), 0);
  for (const Connection& connection : connections(map, index)) {
    const auto a = static_cast<std::size_t>(connection.a);
    const auto b = static_cast<std::size_t>(connection.b);
    const bool in_tree = forest.join(connection.a, connection.b);
    if (!in_tree && degree[a] >= edges_per_keyframe && degree[b] >= edges_per_keyframe) continue;
    ++degree[a];
    ++degree[b];
    graph.edges.push_back({connection.a, connection.b, graph.poses[a].inverse() * graph.poses[b],
                           static_cast<double>(connection.shared)});
  }
  return graph;
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
