#include "tests/vm/uvc/uvc_guest.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <fstream>
#include <stdexcept>

#include "tests/process.h"
#include "tests/vm/uvc/vhci_port.h"

namespace waymark::testing {
namespace {

constexpr std::chrono::milliseconds kPatience(30'000);
constexpr std::size_t kIndexAt = 2;  // behind the first mark
constexpr std::size_t kIndexBytes = 4;

// JPEGs of rooms take about a bit for a pixel; they are not all of the same length.
std::size_t frameBytes(const StreamMode& mode, std::uint64_t index) {
  if (mode.format != PixelFormat::kMjpeg) return mode.max_frame_bytes;
  return static_cast<std::size_t>(mode.width * mode.height) / 8 + 997 * (index % 10);
}

}  // namespace

std::string prepareUvcGuest() {
  for (const char* module : {"vhci-hcd", "uvcvideo"}) {
    const ProgramResult loaded = runProgram({"modprobe", module});
    if (loaded.exit_code != 0) return std::string(module) + ": " + loaded.err;
  }
  if (!setDriverDropsFaultyFrames(true)) return "uvcvideo: nodrop cannot be set";
  for (int port = 0; port < kVhciPorts; ++port) {
    if (!waitUntilFree(port, kPatience)) return "vhci port " + std::to_string(port) + ": in use";
  }
  return {};
}

bool setDriverDropsFaultyFrames(bool drops) {
  std::ofstream file("/sys/module/uvcvideo/parameters/nodrop");
  file << (drops ? 0 : 1) << std::flush;
  return file.good();
}

Bytes numberedFrame(const StreamMode& mode, std::uint64_t index, int camera) {
  Bytes bytes(frameBytes(mode, index));
  std::uint32_t state = static_cast<std::uint32_t>(index) * 8 + static_cast<std::uint32_t>(camera);
  for (std::uint8_t& byte : bytes) {
    state = state * 1664525 + 1013904223;  // a linear congruence, as in Numerical Recipes
    byte = static_cast<std::uint8_t>(state >> 24);
  }
  bytes[0] = 0xff;
  bytes[1] = 0xd8;
  const Bytes number = ByteWriter().le32(static_cast<std::uint32_t>(index)).take();
  std::ranges::copy(number, bytes.begin() + kIndexAt);
  bytes[bytes.size() - 2] = 0xff;
  bytes[bytes.size() - 1] = 0xd9;
  return bytes;
}

std::optional<std::uint64_t> indexOf(ByteView frame, const StreamMode& mode, int camera) {
  if (frame.size() < kIndexAt + kIndexBytes) return std::nullopt;
  const std::uint64_t index = readLe32(frame, kIndexAt);
  if (!std::ranges::equal(frame, numberedFrame(mode, index, camera))) return std::nullopt;
  return index;
}

CameraOptions numberedCamera(Transfer transfer, int camera) {
  CameraOptions options;
  options.transfer = transfer;
  options.frames = [camera](const StreamMode& mode, std::uint64_t index) {
    return numberedFrame(mode, index, camera);
  };
  return options;
}

StreamMode streamMode(PixelFormat format, int width, int height, int rate_hz, Transfer transfer) {
  const std::vector<Format>& formats = offeredFormats();
  const auto f = std::ranges::find(formats, format, &Format::format);
  const auto s = std::ranges::find_if(f->sizes, [width, height](const FrameSize& size) {
    return size.width == width && size.height == height;
  });
  if (s == f->sizes.end()) throw std::invalid_argument("no such size");
  return *modeOf(static_cast<std::uint8_t>(f - formats.begin() + 1),
                 static_cast<std::uint8_t>(s - f->sizes.begin() + 1),
                 10'000'000U / static_cast<std::uint32_t>(rate_hz), transfer);
}

}  // namespace waymark::testing
