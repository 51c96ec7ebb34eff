// Of VisualFilter: points that go out of view, and come back.
#include <algorithm>
#include <optional>

#include "slam/natural/filter/point_view.h"
#include "slam/natural/filter/visual_filter.h"

namespace waymark::slam {
namespace {

// How near the image's border, in pixels, they are looked for.
constexpr double kRecallBorder_px = 12.0;
// Fewer of a view are not worth a camera in the state.
constexpr int kFewestOfView = 3;

}  // namespace

void VisualFilter::remember(int feature) {
  const Feature& f = features_[static_cast<std::size_t>(feature)];
  const StateFeature& state = stateOf(feature);
  if (f.age < options_.features.trial_frames || !isWellKnown(feature)) return;
  const StatePose& anchor = filter_.state().poses()[static_cast<std::size_t>(state.pose)];
  memory_.add(anchor.tag, anchor.T_w_s, filter_.anchorCovariance(state.pose),
              {.look = f.look,
               .uv = state.uv,
               .rho = state.rho,
               .covariance = filter_.state().P<3, 3>(state.offset, state.offset),
               .age = f.age});
}

bool VisualFilter::isInView(const CameraModel& camera, const RememberedView& view,
                            const RememberedPoint& point) const {
  const StateFeature as_feature{.uv = point.uv, .rho = point.rho};
  PointView seen;
  if (!viewFeature(camera, filter_.state().camera(), view.T_w_a, as_feature, &seen)) return false;
  const ExpectedFeature expected{
      .pixel = seen.at, .J_feature = seen.J_feature, .J_forward = seen.J_forward};
  return camera.inImage(seen.at, kRecallBorder_px) && warpOf(point.look, point.rho, expected);
}

int VisualFilter::pointsInView(const CameraModel& camera, const RememberedView& view) const {
  return static_cast<int>(std::ranges::count_if(
      view.points, [&](const RememberedPoint& point) { return isInView(camera, view, point); }));
}

void VisualFilter::recallPoints(const CameraModel& camera, VisualUpdate* result) {
  const double variance = filter_.state().poseCovariance().topLeftCorner<3, 3>().trace();
  const auto is_worth = [&](const RememberedView& view) {
    return options_.features.recalled_when_worse * view.variance() < variance;
  };
  const auto in_state = [&](const RememberedView& view) {
    return view.recalled && filter_.state().findPose(PoseKind::kAnchor, view.anchor).has_value();
  };
  for (std::size_t i = 0; i < memory_.views().size(); ++i) {
    const RememberedView& view = memory_.view(i);
    if (!view.recalled || in_state(view)) continue;
    memory_.forget(i);  // told once more, it would count twice
    return;
  }
  if (std::ranges::none_of(memory_.views(), [&](const RememberedView& view) {
        return is_worth(view) || in_state(view);
      })) {
    told_views_ = 0;
    return;
  }
  // What they are off by is the same for all, as it is from the same markers: of the information,
  // each tells a part. So is what the markers themselves will tell.
  int sharing = told_views_ + 1;
  std::optional<std::size_t> next;
  for (std::size_t i = 0; i < memory_.views().size(); ++i) {
    const RememberedView& view = memory_.view(i);
    const bool known = in_state(view);
    if (!known && !is_worth(view)) continue;
    if (pointsInView(camera, view) < (known ? 1 : kFewestOfView)) continue;
    if (!known) ++sharing;
    if (!next) next = i;
  }
  if (!next) return;
  result->recalled += recall(camera, sharing, &memory_.view(*next));  // others in the next frame
  if (memory_.view(*next).points.empty()) memory_.forget(*next);
}

int VisualFilter::recall(const CameraModel& camera, int sharing, RememberedView* view) {
  const auto in_view = [&](const RememberedPoint& point) { return isInView(camera, *view, point); };
  const auto in_state = [&] {
    return filter_.state().findPose(PoseKind::kAnchor, view->anchor).value_or(-1);
  };
  if (in_state() < 0 && !makeRoomForAnchor()) return 0;
  makeRoomFor(pointsInView(camera, *view));
  int anchor = in_state();
  if (anchor < 0 && !view->recalled) {
    anchor = filter_.addAnchor(view->T_w_a, sharing * view->covariance);
    if (anchor >= 0) ++told_views_;
  }
  if (anchor < 0) return 0;
  view->anchor = filter_.state().poses()[static_cast<std::size_t>(anchor)].tag;
  view->recalled = true;
  int recalled = 0;
  std::erase_if(view->points, [&](const RememberedPoint& point) {
    if (!in_view(point)) return false;
    const int place = filter_.addFeature(anchor, point.uv, point.rho, point.covariance);
    if (place < 0) return false;
    features_[static_cast<std::size_t>(place)] = {
        .look = point.look, .age = point.age, .passed = true};
    ++recalled;
    return true;
  });
  filter_.removeEmptyAnchors();
  return recalled;
}

void VisualFilter::makeRoomFor(int points) {
  const int most = std::max(0, static_cast<int>(features_.size()) - points);
  while (filter_.state().featureCount() > most) {
    int youngest = -1;
    for (std::size_t i = 0; i < features_.size(); ++i) {
      const int feature = static_cast<int>(i);
      if (stateOf(feature).offset < 0) continue;
      if (youngest < 0 || features_[i].age <= ageOf(youngest)) youngest = feature;
    }
    if (youngest < 0) return;
    drop(youngest);
  }
  filter_.removeEmptyAnchors();
}

void VisualFilter::moveWorld(const Transform& T_new_old) {
  filter_.moveWorld(T_new_old);
  memory_.moveWorld(T_new_old);
}

}  // namespace waymark::slam
