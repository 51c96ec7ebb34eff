#include "tests/vm/uvc/v4l2_reader.h"

#include <cerrno>
#include <utility>

#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include "base/system_reason.h"

namespace waymark::testing {
namespace {

constexpr std::uint32_t kCapture = V4L2_BUF_TYPE_VIDEO_CAPTURE;
constexpr std::uint32_t kBufferCount = 8;

v4l2_buffer captureBuffer(std::uint32_t index = 0) {
  v4l2_buffer buffer{};
  buffer.index = index;
  buffer.type = kCapture;
  buffer.memory = V4L2_MEMORY_MMAP;
  return buffer;
}

}  // namespace

Result<std::unique_ptr<V4l2Reader>> V4l2Reader::open(const std::filesystem::path& node) {
  UniqueFd fd(::open(node.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
  if (!fd) return Error{node.string() + ": " + systemReason()};
  return std::unique_ptr<V4l2Reader>(new V4l2Reader(std::move(fd)));
}

V4l2Reader::~V4l2Reader() { unmapBuffers(); }

Status V4l2Reader::call(unsigned long request, void* argument, const char* name) const {
  while (ioctl(fd_.get(), request, argument) != 0) {
    error_number_ = errno;
    if (errno != EINTR) return Error{std::string(name) + ": " + systemReason()};
  }
  return success();
}

std::vector<V4l2Mode> V4l2Reader::modes() const {
  std::vector<V4l2Mode> modes;
  v4l2_fmtdesc format{};
  for (format.type = kCapture; call(VIDIOC_ENUM_FMT, &format, "format").ok(); ++format.index) {
    v4l2_frmsizeenum size{};
    size.pixel_format = format.pixelformat;
    for (; call(VIDIOC_ENUM_FRAMESIZES, &size, "size").ok(); ++size.index) {
      v4l2_frmivalenum interval{};
      interval.pixel_format = format.pixelformat;
      interval.width = size.discrete.width;
      interval.height = size.discrete.height;
      for (; call(VIDIOC_ENUM_FRAMEINTERVALS, &interval, "interval").ok(); ++interval.index) {
        const v4l2_fract& t = interval.discrete;
        modes.push_back({format.pixelformat, static_cast<int>(interval.width),
                         static_cast<int>(interval.height),
                         static_cast<int>((t.denominator + t.numerator / 2) / t.numerator)});
      }
    }
  }
  return modes;
}

std::string V4l2Reader::busInfo() const {
  v4l2_capability capability{};
  if (!call(VIDIOC_QUERYCAP, &capability, "VIDIOC_QUERYCAP")) return {};
  return reinterpret_cast<const char*>(capability.bus_info);
}

Status V4l2Reader::setControl(std::uint32_t id, std::int32_t value) const {
  v4l2_control control{id, value};
  return call(VIDIOC_S_CTRL, &control, "VIDIOC_S_CTRL");
}

Result<std::int32_t> V4l2Reader::control(std::uint32_t id) const {
  v4l2_control control{id, 0};
  const Status got = call(VIDIOC_G_CTRL, &control, "VIDIOC_G_CTRL");
  if (!got) return got.error();
  return control.value;
}

Status V4l2Reader::start(const V4l2Mode& mode) {
  if (Status set = setMode(mode); !set) return set;
  if (Status mapped = mapBuffers(); !mapped) return mapped;
  auto type = kCapture;
  return call(VIDIOC_STREAMON, &type, "VIDIOC_STREAMON");
}

Status V4l2Reader::setMode(const V4l2Mode& mode) {
  v4l2_format format{};
  format.type = kCapture;
  format.fmt.pix.width = static_cast<std::uint32_t>(mode.width);
  format.fmt.pix.height = static_cast<std::uint32_t>(mode.height);
  format.fmt.pix.pixelformat = mode.pixel_format;
  if (Status set = call(VIDIOC_S_FMT, &format, "VIDIOC_S_FMT"); !set) return set;
  const v4l2_pix_format& pix = format.fmt.pix;
  if (pix.pixelformat != mode.pixel_format || static_cast<int>(pix.width) != mode.width ||
      static_cast<int>(pix.height) != mode.height) {
    return Error{"VIDIOC_S_FMT: the driver chose another mode"};
  }
  v4l2_streamparm rate{};
  rate.type = kCapture;
  rate.parm.capture.timeperframe = {1, static_cast<std::uint32_t>(mode.rate_hz)};
  return call(VIDIOC_S_PARM, &rate, "VIDIOC_S_PARM");
}

Status V4l2Reader::mapBuffers() {
  v4l2_requestbuffers request{};
  request.count = kBufferCount;
  request.type = kCapture;
  request.memory = V4L2_MEMORY_MMAP;
  if (Status made = call(VIDIOC_REQBUFS, &request, "VIDIOC_REQBUFS"); !made) return made;
  for (std::uint32_t i = 0; i < request.count; ++i) {
    v4l2_buffer buffer = captureBuffer(i);
    if (Status known = call(VIDIOC_QUERYBUF, &buffer, "VIDIOC_QUERYBUF"); !known) return known;
    void* address = mmap(nullptr, buffer.length, PROT_READ, MAP_SHARED, fd_.get(), buffer.m.offset);
    if (address == MAP_FAILED) return Error{"mmap: " + systemReason()};
    buffers_.push_back({address, buffer.length});
    if (Status queued = call(VIDIOC_QBUF, &buffer, "VIDIOC_QBUF"); !queued) return queued;
  }
  return success();
}

void V4l2Reader::unmapBuffers() {
  for (const Mapping& buffer : buffers_) munmap(buffer.address, buffer.bytes);
  buffers_.clear();
}

Status V4l2Reader::stop() {
  auto type = kCapture;
  if (Status stopped = call(VIDIOC_STREAMOFF, &type, "VIDIOC_STREAMOFF"); !stopped) return stopped;
  unmapBuffers();
  v4l2_requestbuffers none{};
  none.type = kCapture;
  none.memory = V4L2_MEMORY_MMAP;
  return call(VIDIOC_REQBUFS, &none, "VIDIOC_REQBUFS");
}

Result<V4l2Frame> V4l2Reader::read(std::chrono::milliseconds timeout) {
  pollfd entry{fd_.get(), POLLIN, 0};
  if (poll(&entry, 1, static_cast<int>(timeout.count())) == 0) {
    error_number_ = ETIMEDOUT;
    return Error{"no frame in time"};
  }
  v4l2_buffer buffer = captureBuffer();
  if (Status got = call(VIDIOC_DQBUF, &buffer, "VIDIOC_DQBUF"); !got) return got.error();
  V4l2Frame frame;
  const auto* bytes = static_cast<const std::uint8_t*>(buffers_[buffer.index].address);
  frame.bytes.assign(bytes, bytes + buffer.bytesused);
  frame.sequence = buffer.sequence;
  frame.monotonic_ns =
      1'000'000'000LL * buffer.timestamp.tv_sec + 1'000LL * buffer.timestamp.tv_usec;
  frame.error = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
  if (Status queued = call(VIDIOC_QBUF, &buffer, "VIDIOC_QBUF"); !queued) return queued.error();
  return frame;
}

}  // namespace waymark::testing
