#include "slam/mapping/picture_mapper.h"

#include <algorithm>
#include <utility>

#include <Eigen/Cholesky>

#include "base/elapsed.h"
#include "slam/covariance/marginals.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/mapping/gap_mapper.h"
#include "slam/option_checks.h"

namespace waymark::slam {

std::string PictureMapperOptions::invalidReason() const {
  return firstUnmet({
      {min_views >= 1, "a picture needs at least 1 view"},
      {max_views >= min_views, "a picture's max_views must be min_views at least"},
      {isPositive(min_baseline_per_distance), "the baseline of a picture's views must be positive"},
      {isPositive(min_rotation_rad), "the rotation between a picture's views must be positive"},
      {isPositive(max_chi2), "the chi-square of a picture's places must be positive"},
      {moved_after >= 1, "a picture has moved after 1 contradiction at least"},
      {isPositive(carried_pause_s), "the pause between carried views must be positive"},
  });
}

// T_w_m = T_w_c T_c_m: the camera's error moves the picture as a rigid body, and its own is turned
// into the world's axes.
PictureMapper::View PictureMapper::viewOf(const AwaitedFrame& frame, const LateResult& seen) {
  View view{.frame = frame,
            .T_c_m = seen.T_m_c.inverse(),
            .covariance = covarianceOfInverse(seen.T_m_c, seen.covariance)};
  const Transform& T_w_c = *frame.T_w_c;
  view.T_w_m = T_w_c * view.T_c_m;
  const Matrix6d T = rigidTransport(view.T_w_m.p - T_w_c.p);
  view.place_covariance =
      T * frame.covariance * T.transpose() + turnedCovariance(T_w_c.R, view.covariance);
  return view;
}

bool PictureMapper::agrees(const Transform& a, const Transform& b,
                           const Matrix6d& covariance) const {
  const Vector6d between = a.localCoordinates(b);
  return between.dot(covariance.ldlt().solve(between)) <= options_.max_chi2;
}

bool PictureMapper::isElsewhere(const View& other, const View& view) const {
  const Transform T_m_a = other.T_c_m.inverse();
  const Transform T_m_b = view.T_c_m.inverse();
  return (T_m_a.p - T_m_b.p).norm() >= options_.min_baseline_per_distance * T_m_b.p.norm() ||
         rotationDistance(T_m_a.R, T_m_b.R) >= options_.min_rotation_rad;
}

std::optional<PictureJoint> PictureMapper::offer(const AwaitedFrame& frame, const LateResult& seen,
                                                 const Map& map) {
  const MapMarker* const known = map.find(seen.landmark);
  const bool distrusted = known == nullptr || known->state == MarkerState::kBanned;
  if (!frame.T_w_c || frame.anchor == seen.landmark || distrusted) return std::nullopt;
  Sightings& sightings = sightings_[seen.landmark];
  const View view = viewOf(frame, seen);
  return known->T_w_m ? lookAgain(view, *known, &sightings, map)
                      : placeNew(view, seen.landmark, &sightings, map);
}

std::optional<PictureJoint> PictureMapper::placeNew(const View& view, int id, Sightings* sightings,
                                                    const Map& map) const {
  std::vector<View>& views = sightings->views;
  const auto fits = [&](const View& other) {
    return agrees(other.T_w_m, view.T_w_m, other.place_covariance + view.place_covariance);
  };
  if (!std::ranges::all_of(views, fits)) {
    views.clear();
    sightings->agreeing = 0;
  }
  ++sightings->agreeing;
  const auto is_elsewhere = [&](const View& other) { return isElsewhere(other, view); };
  if (std::ranges::all_of(views, is_elsewhere)) views.push_back(view);
  if (sightings->agreeing < options_.min_views) return std::nullopt;

  const auto links = static_cast<double>(views.size());
  const auto doubt = [](const View& v) { return v.place_covariance.trace(); };
  const View& best = *std::ranges::min_element(views, {}, doubt);
  PictureJoint joint{.id = id, .T_w_m = best.T_w_m, .covariance = best.place_covariance};
  for (const View& one : views) {
    auto keyframe = keyframeOf(one, id, links, map);
    if (keyframe) joint.keyframes.push_back(std::move(*keyframe));
  }
  *sightings = {};
  if (joint.keyframes.empty()) return std::nullopt;  // the anchor is not there any more
  return joint;
}

std::optional<PictureJoint> PictureMapper::lookAgain(const View& view, const MapMarker& known,
                                                     Sightings* sightings, const Map& map) const {
  const bool carried = view.frame.anchor >= 0;
  if (!agrees(*known.T_w_m, view.T_w_m, known.covariance + view.place_covariance)) {
    if (carried || ++sightings->contradictions < options_.moved_after) return std::nullopt;
    *sightings = {};
    return PictureJoint{.id = known.id, .moved = true};
  }
  sightings->contradictions = 0;
  const auto linked = map.linkedFrom(known.id);
  const auto is_elsewhere = [&](KeyframeId id) {
    const std::vector<MarkerLink>& links = map.keyframes().at(id).links;
    const auto link = std::ranges::find(links, known.id, &MarkerLink::marker);
    return isElsewhere({.T_c_m = link->T_c_m}, view);
  };
  const std::int64_t now_ns = view.frame.time.monotonic_ns;
  const bool too_soon = carried && sightings->carried_ns &&
                        secondsBetween(*sightings->carried_ns, now_ns) < options_.carried_pause_s;
  if (linked.size() >= options_.max_views || too_soon ||
      !std::ranges::all_of(linked, is_elsewhere)) {
    return std::nullopt;
  }
  auto keyframe = keyframeOf(view, known.id, /*links=*/1.0, map);
  if (!keyframe) return std::nullopt;
  if (carried) sightings->carried_ns = now_ns;
  PictureJoint joint;
  joint.id = known.id;
  joint.keyframes.push_back(std::move(*keyframe));
  return joint;
}

// A link to the picture, and of a carried pose one to the marker that it was carried from: one of
// so many of its stretch, which share its drift.
std::optional<Keyframe> PictureMapper::keyframeOf(const View& view, int picture, double links,
                                                  const Map& map) {
  const AwaitedFrame& frame = view.frame;
  Keyframe keyframe{.sequence = frame.time.sequence,
                    .monotonic_ns = frame.time.monotonic_ns,
                    .T_w_c = *frame.T_w_c,
                    .detections = {frame.detections.begin(), frame.detections.end()},
                    .twist = frame.twist,
                    .links = {{picture, view.T_c_m, view.covariance}}};
  if (frame.anchor < 0) return keyframe;
  const MapMarker* const anchor = map.findPosed(frame.anchor);
  if (anchor == nullptr) return std::nullopt;
  const auto link = linkTo(anchor->id, *anchor->T_w_m, *frame.T_w_c, links * frame.covariance);
  if (!link) return std::nullopt;
  keyframe.links.push_back(*link);
  std::ranges::sort(keyframe.links, {}, &MarkerLink::marker);
  return keyframe;
}

void PictureMapper::moveWorld(const Transform& T_new_old) {
  for (auto& [id, sightings] : sightings_) {
    for (View& view : sightings.views) {
      view.frame.T_w_c = T_new_old * *view.frame.T_w_c;
      view.frame.covariance = turnedCovariance(T_new_old.R, view.frame.covariance);
      view.T_w_m = T_new_old * view.T_w_m;
      view.place_covariance = turnedCovariance(T_new_old.R, view.place_covariance);
    }
  }
}

}  // namespace waymark::slam
