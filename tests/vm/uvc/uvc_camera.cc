#include "tests/vm/uvc/uvc_camera.h"

#include <utility>

#include <sys/socket.h>

namespace waymark::testing {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

UvcCamera::UvcCamera(CameraOptions options) : options_(std::move(options)) {}

UvcCamera::~UvcCamera() { unplug(); }

void UvcCamera::connect(UniqueFd socket) {
  unplug();  // a thread whose host has gone
  socket_ = std::move(socket);
  {
    const std::lock_guard lock(desk_.mutex);
    desk_.state.connected = true;
    desk_.state.controls = UvcControls();
  }
  thread_ = std::thread([this] {
    UvcSession(socket_.get(), options_, &desk_).run();
    const std::lock_guard lock(desk_.mutex);
    desk_.state.connected = false;
    desk_.state.stream.reset();
  });
}

// The descriptor alone would not do: the host's end, or a process that has inherited it, could keep
// the connection alive.
void UvcCamera::unplug() {
  if (!thread_.joinable()) return;
  shutdown(socket_.get(), SHUT_RDWR);
  thread_.join();
  socket_ = UniqueFd();
}

void UvcCamera::damage(Fault fault, int frames) {
  const std::lock_guard lock(desk_.mutex);
  desk_.fault = fault;
  desk_.faulty_frames = frames;
}

void UvcCamera::fallSilent(milliseconds duration) {
  const std::lock_guard lock(desk_.mutex);
  desk_.silent_until = steady_clock::now() + duration;
}

CameraState UvcCamera::state() const {
  const std::lock_guard lock(desk_.mutex);
  return desk_.state;
}

bool UvcCamera::waitFor(const std::function<bool(const CameraState&)>& condition,
                        milliseconds timeout) const {
  const auto until = steady_clock::now() + timeout;
  while (!condition(state())) {
    if (steady_clock::now() >= until) return false;
    std::this_thread::sleep_for(milliseconds(5));
  }
  return true;
}

}  // namespace waymark::testing
