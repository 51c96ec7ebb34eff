// What is known about the printed markers before the first frame.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slam/geometry/transform.h"
#include "slam/map/marker_constraints.h"

namespace waymark::slam {

// A marker whose pose somebody surveyed.
struct Anchor {
  int id = -1;
  Transform T_w_m;
  double sigma_m = 0.001;  // of each coordinate
  double sigma_rad = 0.005;
};

struct MarkerOptions {
  // Side of the printed black square, metres. There is no sensible default.
  double size_m = 0.0;
  struct Size {
    IdRange ids;
    double size_m = 0.0;
  };
  std::vector<Size> other_sizes{};  // the first range that contains an id counts
  std::vector<IdRange> ignored{};   // ids that are never looked at

  // What fixes the world frame; without either, the first keyframe's camera does. Not both.
  std::vector<Anchor> anchors{};       // surveyed poses, in the world they were surveyed in
  std::optional<int> origin_marker{};  // this marker's frame is the world
  // What else is known of where they are. Positions fix the world as anchors do.
  MarkerConstraints constraints{};

  [[nodiscard]] double sizeOf(int id) const;
  [[nodiscard]] bool isIgnored(int id) const;
  // Empty when usable, else which option is wrong and why.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
