// The results of `waymark run`, as the page shows them: the map as a daemon would tell it, and what
// became of each frame, live and against the final map, with the errors against a truth.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "io/text/json_node.h"
#include <waymark/map_t.hpp>
#include <waymark/natural_map_t.hpp>

namespace waymark::view {

struct ResultView {
  std::vector<map_t> map;  // in parts, one after the other
  std::vector<natural_map_t> natural_map;
  // {"type":"result","name","verdict","tracks":[{"name","poses":[[t,x,y,z,qw,qx,qy,qz,piece,sigma_m,
  // markers,rms_px,source] or [t,
  // reason]]}],"truth":[[t,x,y,z]],"errors":[{"name","rms_m","median_m",
  // "max_m","points":[[t,m]]}]}
  io::Json result;
};

// directory: of `waymark run --out`. truth: a TUM trajectory; may be empty. Errors name the file.
[[nodiscard]] Result<ResultView> readResultView(const std::filesystem::path& directory,
                                                const std::filesystem::path& truth);

// One field after the other of a line of CSV (RFC 4180).
[[nodiscard]] std::vector<std::string> csvFields(const std::string& line);

}  // namespace waymark::view
