// What the states of pose_t and health_t are called, in journals, on terminals and in JSON.
#pragma once

#include <cstdint>
#include <string>

#include <waymark/pose_t.hpp>

namespace waymark::daemon {

// "tracking"; "status 7" for a state of a later version.
[[nodiscard]] inline std::string statusName(std::int8_t status) {
  switch (status) {
    case pose_t::STATUS_INITIALIZING:
      return "initializing";
    case pose_t::STATUS_TRACKING:
      return "tracking";
    case pose_t::STATUS_BRIDGING:
      return "bridging";
    case pose_t::STATUS_RELOCALIZING:
      return "relocalizing";
    case pose_t::STATUS_NO_CAMERA:
      return "no camera";
    default:
      return "status " + std::to_string(status);
  }
}

}  // namespace waymark::daemon
