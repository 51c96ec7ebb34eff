#include "slam/natural/filter/point_memory.h"

#include <algorithm>
#include <utility>

#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {

PointMemory::PointMemory(int max_views, int max_points_per_view)
    : views_(static_cast<std::size_t>(max_views)),
      max_points_(static_cast<std::size_t>(max_points_per_view)) {
  for (RememberedView& view : views_) view.points.reserve(max_points_);
}

void PointMemory::add(std::uint64_t anchor, const Transform& T_w_a, const Matrix6d& covariance,
                      const RememberedPoint& point) {
  const auto end = views_.begin() + static_cast<std::ptrdiff_t>(used_);
  auto view = std::find_if(views_.begin(), end,
                           [&](const RememberedView& v) { return v.anchor == anchor; });
  if (view == end) {
    if (views_.empty()) return;
    if (used_ == views_.size()) {
      view = std::ranges::max_element(views_, {}, &RememberedView::variance);
      if (!(covariance.topLeftCorner<3, 3>().trace() < view->variance())) return;
    } else {
      ++used_;
    }
    view->anchor = anchor;
    view->recalled = false;
    view->T_w_a = T_w_a;
    view->covariance = covariance;
    view->points.clear();
  }
  if (view->points.size() < max_points_) view->points.push_back(point);
}

void PointMemory::forget(std::size_t view) {
  --used_;
  if (view != used_) std::swap(views_[view], views_[used_]);
}

void PointMemory::moveWorld(const Transform& T_new_old) {
  for (std::size_t i = 0; i < used_; ++i) {
    views_[i].T_w_a = T_new_old * views_[i].T_w_a;
    views_[i].covariance = turnedCovariance(T_new_old.R, views_[i].covariance);
  }
}

}  // namespace waymark::slam
