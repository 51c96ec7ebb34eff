// The map as subscribers to WAYMARK_MAP put it together from its pieces.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "io/maps/map_file.h"
#include <waymark/map_t.hpp>

namespace waymark::tools {

class LiveMap {
 public:
  // False, and nothing has changed, for a piece with impossible numbers.
  bool add(const map_t& piece);

  // Of the last revision of which every piece came, sorted by id. Empty before the first one.
  [[nodiscard]] const std::vector<io::MarkerCorners>& markers() const { return markers_; }

 private:
  std::int64_t revision_ = 0;  // the one being put together
  std::map<std::int32_t, std::vector<io::MarkerCorners>> pieces_;
  std::vector<io::MarkerCorners> markers_;
};

}  // namespace waymark::tools
