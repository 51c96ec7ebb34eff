// The map as subscribers to WAYMARK_MAP and WAYMARK_NATURAL_MAP put it together from its parts.
#pragma once

#include <vector>

#include "io/maps/map_file.h"
#include "io/maps/map_parts.h"
#include <waymark/map_t.hpp>
#include <waymark/natural_map_t.hpp>

namespace waymark::tools {

class LiveMap {
 public:
  // False, and nothing has changed, for a part with impossible numbers.
  bool add(const map_t& part);
  bool add(const natural_map_t& part);

  // Of the last revision of which every part came, in one piece of the map, which is one world;
  // sorted by id. Empty before the first one.
  [[nodiscard]] std::vector<io::MarkerCorners> markers(int map_piece = 0) const;
  // The same of natural ones, in the order they came in.
  [[nodiscard]] std::vector<io::NaturalMarkerCorners> natural(int map_piece) const;
  // The pieces of the map that have a marker, each a world of its own.
  [[nodiscard]] std::vector<int> worlds() const;

 private:
  io::MapParts<map_t> map_;
  io::MapParts<natural_map_t> natural_;
};

}  // namespace waymark::tools
