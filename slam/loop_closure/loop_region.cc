#include "slam/loop_closure/loop_region.h"

#include <array>
#include <deque>
#include <set>
#include <unordered_set>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>

#include "slam/optimization/normal_equations.h"

namespace waymark::slam {
namespace {

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kVisitView = 0.1;
constexpr double kPrior = 1.0;

constexpr double kLeastRcond = 1e-14;  // of what can be inverted

// Breadth first over keyframes and the markers they see.
class Search {
 public:
  Search(const Map& map, KeyframeId newest) : map_(map), newest_(newest) {}

  void start(KeyframeId keyframe) {
    if (keyframe <= newest_ && map_.keyframes().contains(keyframe) &&
        seen_.insert(keyframe).second) {
      queue_.push_back(keyframe);
    }
  }
  [[nodiscard]] bool done() const { return queue_.empty(); }
  // The next keyframe, its neighbours being queued; null where it has been let go meanwhile.
  // visited: views looked at.
  const Keyframe* next(std::size_t* visited) {
    const KeyframeId id = queue_.front();
    queue_.pop_front();
    const auto found = map_.keyframes().find(id);
    if (found == map_.keyframes().end()) return nullptr;
    for (const MarkerDetection& detection : found->second.detections) {
      ++*visited;
      if (!markers_.insert(detection.id).second) continue;
      // The newest first: in a dense map the nearest ones.
      const auto views = map_.viewsOf(detection.id);
      *visited += views.size();
      for (auto view = views.rbegin(); view != views.rend(); ++view) start(*view);
    }
    return &found->second;
  }

 private:
  const Map& map_;
  KeyframeId newest_;
  std::deque<KeyframeId> queue_;
  std::unordered_set<KeyframeId> seen_;
  std::unordered_set<int> markers_;
};

}  // namespace

Task<std::optional<LoopRegion>> loopRegion(const Map& map, KeyframeId reference,
                                           std::span<const int> loop_markers, std::size_t max_views,
                                           Budget* budget) {
  const KeyframeId newest = map.keyframes().empty() ? -1 : map.keyframes().rbegin()->first;
  // Both ends take turns, so that each has half of the region, wherever they meet.
  std::array<Search, 2> sides = {Search(map, newest), Search(map, newest)};
  sides[0].start(reference);
  for (const int marker : loop_markers) {
    for (const KeyframeId view : map.viewsOf(marker)) sides[1].start(view);
  }
  std::set<KeyframeId> region;
  std::size_t views = 0;
  bool meet = false;
  while (views < max_views && !(sides[0].done() && sides[1].done())) {
    for (Search& side : sides) {
      if (side.done()) continue;
      std::size_t visited = 1;
      const Keyframe* const keyframe = side.next(&visited);
      if (keyframe != nullptr && !keyframe->detections.empty()) {
        if (region.insert(keyframe->id).second) {
          views += keyframe->detections.size();
        } else {
          meet = true;
        }
      }
      co_await budget->spend(kVisitView * static_cast<double>(visited));
    }
  }
  if (!meet || views < max_views) co_return std::nullopt;

  std::set<int> markers;
  for (const KeyframeId id : region) {
    const auto found = map.keyframes().find(id);
    if (found == map.keyframes().end()) continue;
    co_await budget->spend(kVisitView * static_cast<double>(found->second.detections.size()));
    for (const MarkerDetection& detection : found->second.detections) {
      if (map.findPosed(detection.id) != nullptr) markers.insert(detection.id);
    }
  }
  std::set<KeyframeId> others;
  for (const int marker : markers) {
    const auto seen_from = map.viewsOf(marker);
    for (const KeyframeId id : seen_from) {
      if (id <= newest && !region.contains(id)) others.insert(id);
    }
    co_await budget->spend(kVisitView * static_cast<double>(seen_from.size()));
  }
  LoopRegion found;
  found.part.markers.assign(markers.begin(), markers.end());
  found.rest.markers = found.part.markers;
  found.newest = newest;
  for (const KeyframeId id : region) {
    if (map.keyframes().contains(id)) found.part.keyframes.push_back({id, false});
  }
  for (const KeyframeId id : others) {
    if (map.keyframes().contains(id)) found.rest.keyframes.push_back({id, true});
  }
  co_return found;
}

Task<Done> attachToRest(const Map& map, SubproblemMembers rest_members,
                        const MarkerOptions& markers, double huber, Subproblem* part,
                        Budget* budget) {
  Subproblem rest = co_await buildSubproblem(map, std::move(rest_members), markers, budget);
  rest.problem.priors.clear();  // the part has them
  const std::vector<WhitenedCorners> whitened = co_await whitenCorners(rest.problem, budget);
  NormalEquations equations;
  const bool seen = co_await linearize(rest.problem, whitened, huber, &equations, budget);
  if (!seen) co_return Done{};
  for (std::size_t m = 0; m < rest.markers.size(); ++m) {
    const int index = part->markerIndex(rest.markers[m].id);
    if (index < 0 || rest.problem.markers[m].fixed) continue;
    co_await budget->spend(kPrior);
    const Matrix6d& H = equations.H_marker[m];
    const Eigen::LLT<Matrix6d> factor(H);
    if (factor.info() != Eigen::Success || factor.rcond() < kLeastRcond) continue;
    const Transform T_best =
        rest.problem.markers[m].T.retract(-factor.solve(equations.g_marker[m]));
    part->problem.priors.push_back({index, T_best, H});
  }
  co_return Done{};
}

}  // namespace waymark::slam
