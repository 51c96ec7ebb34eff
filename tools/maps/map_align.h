// Moves a map into a world that people have a use for: floor, vertical, origin and heading, said by
// its markers. Rigidly, so that nothing of the map becomes another.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "slam/geometry/transform.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"

namespace waymark::tools {

struct AlignOptions {
  // Markers that lie on the floor, face up: z = 0 there, and z up where `up` says nothing else.
  std::vector<slam::IdRange> floor{};
  // Markers that hang upright: z is the direction that their y axes have in common.
  std::vector<slam::IdRange> up{};
  // The centre of this marker is the origin; over the floor, where one is said, the point of the
  // floor below it. Without, the world's origin stays, or goes to the point of the floor below it.
  std::optional<int> origin{};
  // From the origin marker, the x axis points to this one: as seen from above where floor or
  // upright markers say what is up, else straight, and z stays as near as it can to what it was.
  // Without, the world turns no more than it must.
  std::optional<int> xy{};

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
  // All that are named, for a piece of the map to have.
  [[nodiscard]] std::vector<slam::IdRange> named() const;
};

struct AlignReport {
  slam::Transform T_new_old;
  std::size_t floor_markers = 0;
  double floor_rms_m = 0.0;  // of their centres from the plane
  std::size_t upright_markers = 0;
  double upright_rms_rad = 0.0;  // of their y axes from the vertical
};

// Moves the map. The error says which marker is in the way, and why; the map is then unchanged.
[[nodiscard]] Result<AlignReport> alignMap(slam::Map* map, const AlignOptions& options);

// In a line for each thing that was done.
[[nodiscard]] std::string alignText(const AlignReport& report);

}  // namespace waymark::tools
