// A walk told in beats of a second, that ends where it began.
#pragma once

#include <vector>

#include "simulator/trajectory.h"

namespace waymark::simulator {

// Where a walker is and looks. The curve through the beats is a B-spline: it rounds corners off
// over about two beats, and stands exactly still from the second beat of a rest to its last but
// one.
class Itinerary {
 public:
  struct Stop {
    double x_m = 0.0;
    double y_m = 0.0;
    double yaw_deg = 0.0;
  };

  explicit Itinerary(const Stop& start);

  // Evenly to the stop. Yaw goes the way of its number: from 90 to -270 is once round.
  Itinerary& go(const Stop& to, int beats);
  // The same with a camera that nothing shakes: a turn in place, or, without a stop, a rest.
  Itinerary& goStill(const Stop& to, int beats);
  Itinerary& rest(int beats) { return goStill(at_, beats); }

  [[nodiscard]] double duration_s() const { return static_cast<double>(knots_.size()); }

  // Precondition: it is back where it began, in whole turns.
  class Path {
   public:
    [[nodiscard]] View at(double time_s, double height_m) const;
    // 0 where the camera is still, 1 where it is carried.
    [[nodiscard]] double liveliness(double time_s) const;

   private:
    friend class Itinerary;
    Path(ClosedSpline spline, double duration_s)
        : spline_(std::move(spline)), duration_s_(duration_s) {}
    ClosedSpline spline_;  // x, y, yaw, liveliness
    double duration_s_;
  };
  [[nodiscard]] Path path() const;

 private:
  Itinerary& add(const Stop& to, int beats, double liveliness);

  Stop at_;
  std::vector<Eigen::Vector4d> knots_;
};

// The view with `share` of the sway that a hand has at this time.
[[nodiscard]] View swayed(const View& view, const Sway& sway, double share, double time_s);

}  // namespace waymark::simulator
