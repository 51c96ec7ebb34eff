// A UVC camera made of software: it can be plugged into the kernel's virtual host controller
// (vhci_port.h), streams what it is given at the pace the host asks for, and fails on command.
// Tests only.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

#include "base/unique_fd.h"
#include "tests/vm/uvc/uvc_session.h"

namespace waymark::testing {

// Has a thread of its own while it is connected. All members may be called from any one thread.
class UvcCamera {
 public:
  explicit UvcCamera(CameraOptions options);
  UvcCamera(const UvcCamera&) = delete;
  UvcCamera& operator=(const UvcCamera&) = delete;
  ~UvcCamera();

  // Speaks USB/IP with the host at the other end of the socket. Controls are at their defaults, as
  // with any camera that loses power. Precondition: not connected.
  void connect(UniqueFd socket);
  // Like pulling the plug, also in the middle of a frame. Nothing happens when not connected.
  void unplug();

  // The next `frames` frames are damaged. Replaces what was asked for before.
  void damage(Fault fault, int frames);
  // Sends no frame for that long, counted from now. It goes on answering requests.
  void fallSilent(std::chrono::milliseconds duration);

  [[nodiscard]] CameraState state() const;
  // Waits until it holds; false when it does not within `timeout`.
  [[nodiscard]] bool waitFor(const std::function<bool(const CameraState&)>& condition,
                             std::chrono::milliseconds timeout) const;

 private:
  const CameraOptions options_;
  CameraDesk desk_;
  UniqueFd socket_;
  std::thread thread_;
};

}  // namespace waymark::testing
