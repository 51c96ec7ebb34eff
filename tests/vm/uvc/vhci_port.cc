#include "tests/vm/uvc/vhci_port.h"

#include <fstream>
#include <optional>
#include <sstream>
#include <thread>
#include <utility>

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/system_reason.h"
#include "base/unique_fd.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

const fs::path kController = "/sys/devices/platform/vhci_hcd.0";
constexpr milliseconds kPatience(5000);
constexpr milliseconds kBetweenLooks(10);

// Values of the status file, and of the kernel's speeds.
constexpr int kPortFree = 4;
constexpr int kHighSpeed = 3;
// Any number: the socket says which device it is.
constexpr int kDeviceId = 0x00010002;

// Lines of the status file: hub ("hs" or "ss"), port, state, and what is plugged in.
std::optional<int> stateOf(int port) {
  std::ifstream file(kController / "status");
  std::string line;
  while (std::getline(file, line)) {
    std::istringstream fields(line);
    std::string hub;
    int number = -1;
    int state = 0;
    if (fields >> hub >> number >> state && hub == "hs" && number == port) return state;
  }
  return std::nullopt;
}

// Where the USB core keeps what is plugged in at the port: BUS-PORT, of the root hub at 480 Mbit/s.
fs::path devicePath(int port) {
  std::error_code error;
  for (const auto& hub : fs::directory_iterator(kController, error)) {
    const std::string name = hub.path().filename();
    int speed_mbit = 0;
    std::ifstream(hub.path() / "speed") >> speed_mbit;
    if (name.starts_with("usb") && speed_mbit == 480) {
      return hub.path() / (name.substr(3) + "-" + std::to_string(port + 1));
    }
  }
  return {};
}

// The driver makes two nodes: the first is for frames, the second for their metadata.
std::optional<fs::path> nodeOf(const fs::path& device) {
  std::error_code error;
  for (const auto& interface : fs::directory_iterator(device, error)) {
    for (const auto& node : fs::directory_iterator(interface.path() / "video4linux", error)) {
      int index = -1;
      std::ifstream(node.path() / "index") >> index;
      const fs::path path = "/dev" / node.path().filename();
      if (index == 0 && fs::exists(path)) return path;
    }
  }
  return std::nullopt;
}

Error portError(int port, const std::string& reason) {
  return Error{"vhci port " + std::to_string(port) + ": " + reason};
}

}  // namespace

Status plugIn(UvcCamera* camera, int port) {
  if (!stateOf(port)) return portError(port, "not there; is vhci-hcd loaded?");
  if (!waitUntilFree(port, kPatience)) return portError(port, "in use");
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    return portError(port, systemReason());
  }
  UniqueFd device_end(ends[0]);
  const UniqueFd host_end(ends[1]);  // the kernel keeps the socket for itself
  const UniqueFd attach(open((kController / "attach").c_str(), O_WRONLY | O_CLOEXEC));
  if (!attach) return portError(port, "cannot attach: " + systemReason());

  camera->connect(std::move(device_end));
  std::ostringstream line;
  line << port << " " << host_end.get() << " " << kDeviceId << " " << kHighSpeed;
  const std::string text = line.str();
  if (write(attach.get(), text.data(), text.size()) < 0) {
    const std::string reason = systemReason();
    camera->unplug();
    return portError(port, "cannot attach: " + reason);
  }
  return success();
}

Result<fs::path> videoNode(int port, milliseconds timeout) {
  const auto until = steady_clock::now() + timeout;
  while (true) {
    if (const auto node = nodeOf(devicePath(port))) return *node;
    if (steady_clock::now() >= until) return portError(port, "no video node appeared");
    std::this_thread::sleep_for(kBetweenLooks);
  }
}

fs::path videoLink(int port) {
  return "/dev/v4l/by-path/platform-vhci_hcd.0-usb-0:" + std::to_string(port + 1) +
         ":1.0-video-index0";
}

bool waitForPath(const fs::path& path, milliseconds timeout) {
  const auto until = steady_clock::now() + timeout;
  while (!fs::exists(path)) {
    if (steady_clock::now() >= until) return false;
    std::this_thread::sleep_for(kBetweenLooks);
  }
  return true;
}

bool waitUntilFree(int port, milliseconds timeout) {
  const auto until = steady_clock::now() + timeout;
  while (true) {
    // The controller lets go of the port before the hub has taken its device away.
    if (stateOf(port) == kPortFree && !fs::exists(devicePath(port))) return true;
    if (steady_clock::now() >= until) return false;
    std::this_thread::sleep_for(kBetweenLooks);
  }
}

}  // namespace waymark::testing
