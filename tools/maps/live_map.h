// The map as subscribers to WAYMARK_MAP and WAYMARK_NATURAL_MAP put it together from its parts.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "io/maps/map_file.h"
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
  // What comes in parts, by piece of the map.
  template <typename Corners>
  struct Worlds {
    using ByPiece = std::map<int, std::vector<Corners>>;

    std::int64_t revision = 0;              // the one being put together
    std::map<std::int32_t, ByPiece> parts;  // of it
    ByPiece whole;

    // Whether the revision is whole with it.
    template <typename Message>
    bool add(const Message& part, ByPiece corners);
  };

  Worlds<io::MarkerCorners> markers_;
  Worlds<io::NaturalMarkerCorners> natural_;
};

}  // namespace waymark::tools
