#include "slam/camera/lens_change.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <ranges>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "slam/camera/readout_estimate.h"
#include "slam/camera/rolling_shutter.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/optimization/map_optimizer.h"

namespace waymark::slam {
namespace {

// A change is noticed within 2 s; what is older than this is taken to be of the lens before, unless
// it turns out to be of the new one.
constexpr std::int64_t kLookBack_ns = 6'000'000'000;
// So much better, in chi-square, a keyframe fits through the lens that it was certainly seen with.
constexpr double kCertain = 30.0;
// The markers' places follow from so many keyframes at most that each was seen from: the newest.
constexpr std::size_t kViews = 12;
constexpr double kFitMarker = 10.0;  // microseconds of a core of 3 GHz, as all of Budget here

// So badly a marker fits at most, as a chi-square: something else is wrong with it.
constexpr double kWorst = 100.0;

std::vector<const Keyframe*> keyframesSince(const Map& map, std::int64_t since_ns,
                                            std::int64_t until_ns) {
  std::vector<const Keyframe*> since;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const std::int64_t time_ns = keyframe.monotonic_ns;
    if (time_ns >= since_ns && time_ns <= until_ns) since.push_back(&keyframe);
  }
  std::ranges::sort(since, {}, &Keyframe::monotonic_ns);
  return since;
}

// Who says where the markers in view of these were before.
SubproblemMembers mapBefore(const Map& map, std::span<const Keyframe* const> since,
                            std::int64_t before_ns, std::int64_t first_ns) {
  std::set<int> markers;
  for (const Keyframe* keyframe : since) {
    for (const MarkerDetection& seen : keyframe->detections) markers.insert(seen.id);
  }
  std::set<KeyframeId> ids;
  for (const int id : markers) {
    std::size_t views = 0;
    for (const KeyframeId view : std::views::reverse(map.viewsOf(id))) {
      const std::int64_t time_ns = map.keyframes().at(view).monotonic_ns;
      if (time_ns >= before_ns || time_ns < first_ns) continue;
      ids.insert(view);
      if (++views == kViews) break;
    }
  }
  SubproblemMembers roles;
  for (const KeyframeId id : ids) roles.keyframes.push_back({id, roles.keyframes.empty()});
  const std::vector<KeyframeId> from(ids.begin(), ids.end());
  roles.markers = map.markersSeenFrom(from);
  return roles;
}

// The markers alone, where these have them.
Map markersOf(const MapCorrection& before, const Map& map) {
  Map markers;
  for (const auto& [marker, T_w_m, covariance] : before.markers) {
    markers.addMarker(marker.id, map.markers().at(marker.id).size_m);
    markers.place(marker.id, T_w_m, std::nullopt, covariance);
  }
  return markers;
}

// Chi-square of a keyframe's corners through a lens, the camera being where they have it best.
double misfit(const Keyframe& keyframe, const CameraModel& camera, double readout_s,
              const Map& markers) {
  std::vector<MarkerDetection> detections;
  double chi2 = 0.0;
  for (const MarkerDetection& seen : keyframe.detections) {
    const MapMarker* const marker = markers.findPosed(seen.id);
    if (marker == nullptr) continue;
    const auto through = deskewed(seen, camera, keyframe.T_w_c, keyframe.twist, marker->T_w_m,
                                  marker->size_m, readout_s);
    if (through) {
      detections.push_back(*through);
    } else {
      chi2 += kWorst;
    }
  }
  const std::vector<KnownMarker> known = knownMarkers(markers, detections);
  if (known.empty()) return chi2;
  const auto solution = PoseOptimizer(camera.focalLength()).optimize(known, keyframe.T_w_c);
  for (const KnownMarker& marker : known) {
    const auto its = solution ? PoseOptimizer::markerChi2(marker, solution->T_w_c) : std::nullopt;
    chi2 += std::min(its.value_or(kWorst), kWorst);
  }
  return chi2;
}

// How much better keyframes fit through the lens before than through the new one: chi-square.
using Fits = std::vector<double>;

Task<Fits> fitThroughBoth(std::span<const Keyframe* const> keyframes, const LensChange& change,
                          const Map& markers, Budget* budget) {
  Fits old_better;
  for (const Keyframe* const keyframe : keyframes) {
    co_await budget->spend(2.0 * kFitMarker * static_cast<double>(keyframe->detections.size()));
    old_better.push_back(misfit(*keyframe, change.after, change.readout_s, markers) -
                         misfit(*keyframe, change.before, change.readout_s, markers));
  }
  co_return old_better;
}

// The first that was seen through the new lens, as most likely; the number of all where none was.
std::size_t firstOfNew(const Fits& old_better) {
  double cost = 0.0;
  double least = 0.0;
  std::size_t first = 0;
  for (std::size_t k = 0; k < old_better.size(); ++k) {
    cost -= old_better[k];
    if (cost >= least) continue;
    least = cost;
    first = k + 1;
  }
  return first;
}

}  // namespace

Task<std::optional<std::int64_t>> dateChange(const Map& map, LensChange change,
                                             const MarkerOptions& markers, BundleOptions options,
                                             Budget* budget) {
  // NOLINTNEXTLINE(performance-unnecessary-copy-initialization): the map goes on between slices
  const Map seen = map;
  const BundleOptions of_all = ungated(options);
  std::optional<std::int64_t> date;
  bool came_nearer = false;
  std::int64_t back_ns = kLookBack_ns;
  std::int64_t before_ns = change.noticed_ns - back_ns;
  while (true) {
    const auto since = keyframesSince(seen, std::max(before_ns, change.first_ns),
                                      change.noticed_ns + kLookBack_ns);
    SubproblemMembers roles = mapBefore(seen, since, before_ns, change.first_ns);
    if (roles.keyframes.size() < 2) co_return date;
    const MapCorrection before =
        co_await optimizeSubproblem(seen, std::move(roles), markers, of_all, budget);
    if (before.summary.failed) co_return date;
    const Map known = markersOf(before, seen);
    const Fits old_better = co_await fitThroughBoth(since, change, known, budget);
    const std::size_t first = firstOfNew(old_better);
    const auto split = old_better.begin() + static_cast<std::ptrdiff_t>(first);
    const bool any_new =
        std::any_of(split, old_better.end(), [](double better) { return better < -kCertain; });
    if (any_new) date = since[first]->monotonic_ns;
    const auto last_old = std::find_if(std::reverse_iterator(split), old_better.rend(),
                                       [](double better) { return better > kCertain; });
    if (last_old != old_better.rend()) {
      // These know more of the markers that came into view just before the change.
      came_nearer = true;
      before_ns =
          since[static_cast<std::size_t>(old_better.rend() - last_old) - 1]->monotonic_ns + 1;
    } else if (any_new && first == 0 && !came_nearer) {
      before_ns -= back_ns;
      back_ns *= 2;
    } else {
      co_return date;
    }
  }
}

}  // namespace waymark::slam
