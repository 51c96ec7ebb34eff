// What clients of the control socket may ask for: one JSON object a line.
#pragma once

#include <filesystem>
#include <string>
#include <variant>

#include "base/result.h"
#include "daemon/system/log.h"

namespace waymark::daemon {

struct StatusRequest {};
struct SaveMapRequest {};
struct LoadMapRequest {
  std::filesystem::path file;  // empty: the map that the daemon would start with
};
struct ResetRequest {};
struct CalibrationRequest {};  // of the lens in use
struct RecordRequest {
  bool start = true;  // else stop
};
struct PreviewRequest {};  // for some seconds
struct ReloadRequest {};
struct SetLogLevelRequest {
  LogLevel level = LogLevel::kInfo;
};

using ControlRequest =
    std::variant<StatusRequest, SaveMapRequest, LoadMapRequest, ResetRequest, CalibrationRequest,
                 RecordRequest, PreviewRequest, ReloadRequest, SetLogLevelRequest>;

// {"command":"load-map","file":"/var/lib/waymark/map.json"} and the like; docs/control.md lists
// them. Unknown commands and keys, missing ones and wrong values are errors that name them.
[[nodiscard]] Result<ControlRequest> parseControlRequest(const std::string& line);

}  // namespace waymark::daemon
