// Natural markers as the map knows them (seed 2, section 3.1): pictures whose print is known. Each
// is a marker of the map that has no corners in any frame; links say where it was seen.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/transform.h"

namespace waymark::slam {

struct PicturePrint {
  std::string name;
  double width_m = 0.0;
  double height_m = 0.0;
  // Where somebody surveyed it, and how well: then the world is the survey's.
  std::optional<Transform> T_w_m{};
  double sigma_m = 0.005;  // of each coordinate: a tape measure
  double sigma_rad = 0.01;
  // Points on the print (x right, y up, metres) that features may begin at.
  std::vector<Eigen::Vector2d> points_m{};
};

// Ids of pictures begin where no dictionary's end. They come from the name, so that a picture has
// the same one in every map and every set (FNV-1a; two of a thousand names share one once in 2,000
// sets, which whoever reads the set refuses).
inline constexpr int kFirstPictureId = 1 << 30;

[[nodiscard]] constexpr bool isPicture(int marker_id) { return marker_id >= kFirstPictureId; }

[[nodiscard]] constexpr int pictureId(std::string_view name) {
  std::uint32_t hash = 2166136261U;
  for (const char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619U;
  return kFirstPictureId + static_cast<int>(hash % static_cast<std::uint32_t>(kFirstPictureId));
}

}  // namespace waymark::slam
