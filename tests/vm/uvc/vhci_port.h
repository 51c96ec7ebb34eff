// Ports of the kernel's virtual USB host controller (module vhci-hcd), and the video nodes that the
// drivers make of what is plugged in there. Needs root. Tests only.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>

#include "base/result.h"
#include "tests/vm/uvc/uvc_camera.h"

namespace waymark::testing {

// High-speed ports count from 0; there are eight.
inline constexpr int kVhciPorts = 8;

// Plugs the camera into the port, once the port is free: what was unplugged there leaves it within
// some milliseconds. An Error says which port and why.
[[nodiscard]] Status plugIn(UvcCamera* camera, int port);

// The device file from which the frames come, "/dev/videoN", of what is plugged in at the port,
// once the driver has made it.
[[nodiscard]] Result<std::filesystem::path> videoNode(int port, std::chrono::milliseconds timeout);

// The link that udev makes to it, a little later: it names the port.
[[nodiscard]] std::filesystem::path videoLink(int port);

// Waits until there is such a file; false when there is none within `timeout`.
[[nodiscard]] bool waitForPath(const std::filesystem::path& path,
                               std::chrono::milliseconds timeout);

// Waits until neither the controller nor the USB core knows of anything at the port.
[[nodiscard]] bool waitUntilFree(int port, std::chrono::milliseconds timeout);

}  // namespace waymark::testing
