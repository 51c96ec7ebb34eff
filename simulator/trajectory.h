// Where the camera is at each moment: smooth paths, with the sway of a hand on top.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/transform.h"

namespace waymark::simulator {

// T_w_c at a time in seconds; smooth, and defined for every time.
using Trajectory = std::function<slam::Transform(double time_s)>;

// A place and a direction of view in a world whose z is up. Radians; yaw counts from world x
// towards y, pitch upwards, roll clockwise as the camera's holder sees it.
struct View {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // metres
  double yaw = 0.0;
  double pitch = 0.0;
  double roll = 0.0;
};

// T_w_c of a camera (x right, y down, z forward) with that view.
[[nodiscard]] slam::Transform cameraPose(const View& view);

// The view from `position` with `target` in the middle of the image.
[[nodiscard]] View viewTowards(const Eigen::Vector3d& position, const Eigen::Vector3d& target);

// The unsteady hand: a few sines each on position and angles, with seeded phases. All have whole
// numbers of cycles in `period_s`, so that a closed path stays closed.
class Sway {
 public:
  struct Amplitudes {
    double position_m = 0.03;
    double yaw = 0.06;  // radians, as the next two
    double pitch = 0.06;
    double roll = 0.05;
  };

  Sway(std::uint64_t seed, double period_s, const Amplitudes& amplitudes);

  [[nodiscard]] View apply(View view, double time_s) const;

 private:
  static constexpr int kChannels = 6;  // x, y, z, yaw, pitch, roll
  struct Wave {
    double amplitude;
    double radians_per_s;
    double phase;
  };

  std::vector<Wave> waves_[kChannels];
};

// A closed curve through the neighbourhood of its knots: a periodic uniform cubic B-spline, smooth
// to the second derivative. Columns of a knot are whatever the caller wants interpolated.
class ClosedSpline {
 public:
  // `turn` is added to the values on each way round (a yaw that grows by 2 pi).
  ClosedSpline(std::vector<Eigen::Vector4d> knots, const Eigen::Vector4d& turn);

  // progress 0 .. 1 is one way round.
  [[nodiscard]] Eigen::Vector4d at(double progress) const;

 private:
  [[nodiscard]] Eigen::Vector4d knot(int index) const;

  std::vector<Eigen::Vector4d> knots_;
  Eigen::Vector4d turn_;
};

}  // namespace waymark::simulator
