// The map as subscribers to WAYMARK_MAP put it together from its parts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "io/maps/map_file.h"
#include <waymark/map_t.hpp>

namespace waymark::tools {

class LiveMap {
 public:
  // False, and nothing has changed, for a part with impossible numbers.
  bool add(const map_t& part);

  // Of the last revision of which every part came, in one piece of the map, which is one world;
  // sorted by id. Empty before the first one.
  [[nodiscard]] std::vector<io::MarkerCorners> markers(int map_piece = 0) const;
  // How many worlds there are.
  [[nodiscard]] std::size_t worlds() const { return worlds_.size(); }

 private:
  using Worlds = std::map<int, std::vector<io::MarkerCorners>>;  // by piece of the map

  std::int64_t revision_ = 0;             // the one being put together
  std::map<std::int32_t, Worlds> parts_;  // of it
  Worlds worlds_;
};

}  // namespace waymark::tools
