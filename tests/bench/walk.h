// What the long runs see: a camera's way past markers, worked out beforehand, again and again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "base/result.h"
#include "simulator/scene.h"
#include "slam/geometry/camera_model.h"

namespace waymark::bench {

struct WalkOptions {
  std::string scene = "walls";  // of the simulator, or "hall"
  std::uint64_t seed = 1;
  // Until the way repeats itself, seconds; the simulator's scenes only. Long enough for several
  // rounds, in each of which the hand sways differently.
  double loop_s = 300.0;
};

// One time round; after the last frame comes the first again.
struct Walk {
  struct Frame {
    slam::Transform T_w_c;
    std::vector<simulator::Marker> in_view;
  };
  slam::Calibration camera;
  double rate_hz = 0.0;
  double marker_size_m = 0.0;
  std::vector<simulator::Marker> markers;
  std::vector<Frame> frames;
};

// Through two halls, of which each is a piece of the map at first: the camera walks through the one
// and, after some seconds in the dark, through the other one; then the door between them opens, and
// it goes to and fro through both.
struct TwoHalls {
  Walk walk;
  std::size_t door_opens = 0;  // the frame
};

// With so many markers of 25 cm on the ceiling of each, a metre apart; ids of the second one follow
// those of the first. The way does not close.
[[nodiscard]] TwoHalls walkThroughTwoHalls(int markers_each, double rate_hz, std::uint64_t seed);

// An Error says which option is wrong.
[[nodiscard]] Result<Walk> planWalk(const WalkOptions& options);

// A hall of 50 x 40 m with 2,000 markers of 25 cm on its ceiling, a metre apart, 3.5 m above a
// camera that is carried along its lanes, one after the other, and back along the side.
[[nodiscard]] Walk walkThroughHall(std::uint64_t seed);

}  // namespace waymark::bench
