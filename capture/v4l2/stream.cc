#include "capture/v4l2/stream.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <utility>

#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/mman.h>

#include "base/image_view.h"
#include "capture/pixel_format.h"
#include "capture/v4l2/driver_time.h"

namespace waymark::capture::v4l2 {
namespace {

constexpr int kMinBuffers = 2;

// A buffer as the ioctls pass it; with several planes, their descriptions lie beside it.
struct BufferArgument {
  BufferArgument(const Device& device, int index) {
    buffer.index = static_cast<std::uint32_t>(index);
    buffer.type = device.bufferType();
    buffer.memory = V4L2_MEMORY_MMAP;
    if (device.multiplanar()) {
      buffer.m.planes = planes.data();
      buffer.length = static_cast<std::uint32_t>(planes.size());
    }
  }
  BufferArgument(const BufferArgument&) = delete;
  BufferArgument& operator=(const BufferArgument&) = delete;

  // Of the first plane.
  [[nodiscard]] std::size_t length() const { return several() ? planes[0].length : buffer.length; }
  [[nodiscard]] std::uint32_t offset() const {
    return several() ? planes[0].m.mem_offset : buffer.m.offset;
  }
  [[nodiscard]] std::span<const std::uint8_t> used(std::span<const std::uint8_t> memory) const {
    const std::size_t begin = several() ? planes[0].data_offset : 0;
    const std::size_t end = several() ? planes[0].bytesused : buffer.bytesused;
    if (begin >= end || end > memory.size()) return {};
    return memory.subspan(begin, end - begin);
  }
  [[nodiscard]] bool several() const { return buffer.type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE; }

  v4l2_buffer buffer{};
  std::array<v4l2_plane, VIDEO_MAX_PLANES> planes{};
};

// What S_FMT made of what was asked, of one plane or of several.
struct SetFormat {
  std::uint32_t fourcc, width, height, field, stride;
};

SetFormat readBack(const Device& device, const v4l2_format& format) {
  if (device.multiplanar()) {
    const v4l2_pix_format_mplane& pix = format.fmt.pix_mp;
    return {pix.pixelformat, pix.width, pix.height, pix.field, pix.plane_fmt[0].bytesperline};
  }
  const v4l2_pix_format& pix = format.fmt.pix;
  return {pix.pixelformat, pix.width, pix.height, pix.field, pix.bytesperline};
}

std::string modeText(std::uint32_t fourcc, int width, int height) {
  return fourccText(fourcc) + " " + sizeText(width, height);
}

}  // namespace

MappedBuffer::MappedBuffer(MappedBuffer&& other) noexcept
    : address_(std::exchange(other.address_, nullptr)), size_(std::exchange(other.size_, 0)) {}

MappedBuffer& MappedBuffer::operator=(MappedBuffer&& other) noexcept {
  std::swap(address_, other.address_);
  std::swap(size_, other.size_);
  return *this;
}

MappedBuffer::~MappedBuffer() {
  if (address_ != nullptr) munmap(address_, size_);
}

Result<Stream> Stream::open(const Device& device, const ChosenMode& mode, int buffers) {
  Stream stream(device);
  if (const Status set = stream.setFormat(mode); !set) return set.error();
  stream.setRate(mode);
  if (const Status requested = stream.requestBuffers(buffers); !requested) {
    return requested.error();
  }
  return stream;
}

Status Stream::setFormat(const ChosenMode& mode) {
  v4l2_format format{};
  format.type = device_->bufferType();
  const auto fill = [&](auto& pix) {
    pix.pixelformat = mode.fourcc;
    pix.width = static_cast<std::uint32_t>(mode.width);
    pix.height = static_cast<std::uint32_t>(mode.height);
    pix.field = V4L2_FIELD_NONE;
  };
  if (device_->multiplanar()) {
    fill(format.fmt.pix_mp);
  } else {
    fill(format.fmt.pix);
  }
  const std::string wanted = modeText(mode.fourcc, mode.width, mode.height);
  if (device_->call(VIDIOC_S_FMT, &format) != 0) return device_->error("setting " + wanted);

  const SetFormat got = readBack(*device_, format);
  const int width = static_cast<int>(got.width);
  const int height = static_cast<int>(got.height);
  if (got.fourcc != mode.fourcc || width != mode.width || height != mode.height) {
    return Error{device_->path() + ": asked for " + wanted + ", the driver gives " +
                 modeText(got.fourcc, width, height)};
  }
  interlaced_ = got.field != V4L2_FIELD_NONE && got.field != V4L2_FIELD_ANY;
  const auto least =
      static_cast<std::ptrdiff_t>(bytesPerRow(findPixelFormat(mode.fourcc)->layout, mode.width));
  // Compressed pictures have no rows, and some drivers say 0 for rows without gaps.
  stride_ = least == 0 ? 0 : std::max(least, static_cast<std::ptrdiff_t>(got.stride));
  return success();
}

// A driver that cannot be asked goes at its own rate.
void Stream::setRate(const ChosenMode& mode) {
  rate_hz_ = mode.rate_hz;
  v4l2_streamparm parameters{};
  parameters.type = device_->bufferType();
  if (device_->call(VIDIOC_G_PARM, &parameters) != 0) return;
  v4l2_captureparm& capture = parameters.parm.capture;
  if (mode.rate_hz > 0.0 && (capture.capability & V4L2_CAP_TIMEPERFRAME) != 0) {
    // As a ratio of integers that 30000/1001 fits in.
    capture.timeperframe = {1001, static_cast<std::uint32_t>(std::lround(1001 * mode.rate_hz))};
    if (device_->call(VIDIOC_S_PARM, &parameters) != 0) return;
  }
  const v4l2_fract& interval = capture.timeperframe;
  if (interval.numerator > 0 && interval.denominator > 0) {
    rate_hz_ = static_cast<double>(interval.denominator) / static_cast<double>(interval.numerator);
  }
}

Status Stream::requestBuffers(int count) {
  v4l2_requestbuffers request{};
  request.count = static_cast<std::uint32_t>(count);
  request.type = device_->bufferType();
  request.memory = V4L2_MEMORY_MMAP;
  if (device_->call(VIDIOC_REQBUFS, &request) != 0) {
    const bool busy = errno == EBUSY;
    Error error = device_->error("asking for buffers");
    if (busy) error.message += " (another program streams from it)";
    return error;
  }
  const int got = static_cast<int>(request.count);
  if (got < kMinBuffers) {
    return Error{device_->path() + ": the driver gives only " + std::to_string(got) + " buffers"};
  }
  mapped_.resize(static_cast<std::size_t>(got));
  dma_bufs_.resize(static_cast<std::size_t>(got));
  buffers_ = CameraBuffers(got);
  for (int i = 0; i < got; ++i) {
    if (Status mapped = map(i); !mapped) return mapped;
    exportDmaBuf(i);
  }
  return success();
}

Status Stream::map(int index) {
  BufferArgument argument(*device_, index);
  if (device_->call(VIDIOC_QUERYBUF, &argument.buffer) != 0) {
    return device_->error("looking at buffer " + std::to_string(index));
  }
  void* const address = mmap(nullptr, argument.length(), PROT_READ, MAP_SHARED, device_->fd(),
                             static_cast<off_t>(argument.offset()));
  if (address == MAP_FAILED) return device_->error("mapping buffer " + std::to_string(index));
  mapped_[static_cast<std::size_t>(index)] = MappedBuffer(address, argument.length());
  return success();
}

void Stream::exportDmaBuf(int index) {
  v4l2_exportbuffer exported{};
  exported.type = device_->bufferType();
  exported.index = static_cast<std::uint32_t>(index);
  exported.flags = O_RDONLY | O_CLOEXEC;
  if (device_->call(VIDIOC_EXPBUF, &exported) == 0) {
    dma_bufs_[static_cast<std::size_t>(index)] = UniqueFd(exported.fd);
  }
}

Status Stream::start() {
  for (int i = 0; i < buffers_.count(); ++i) {
    if (Status queued = enqueue(i); !queued) return queued;
  }
  std::uint32_t type = device_->bufferType();
  if (device_->call(VIDIOC_STREAMON, &type) == 0) return success();
  const bool no_bandwidth = errno == ENOSPC;
  Error error = device_->error("starting the stream");
  if (no_bandwidth) error.message += " (the USB bus has no bandwidth left for it)";
  return error;
}

bool Stream::wait(std::chrono::nanoseconds timeout) const {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(timeout);
  const timespec longest{.tv_sec = seconds.count(), .tv_nsec = (timeout - seconds).count()};
  // Without a buffer at the driver, poll() reports an error at once.
  if (buffers_.withCamera() == 0) {
    nanosleep(&longest, nullptr);
    return true;
  }
  pollfd descriptor{.fd = device_->fd(), .events = POLLIN, .revents = 0};
  const int ready = ppoll(&descriptor, 1, &longest, nullptr);
  return ready <= 0 || (descriptor.revents & (POLLERR | POLLHUP | POLLNVAL)) == 0;
}

Result<std::optional<FilledBuffer>> Stream::dequeue() {
  if (buffers_.withCamera() == 0) return std::optional<FilledBuffer>();
  BufferArgument argument(*device_, 0);
  if (device_->call(VIDIOC_DQBUF, &argument.buffer) != 0) {
    if (errno == EAGAIN) return std::optional<FilledBuffer>();
    return device_->error("waiting for a frame");
  }
  buffers_.taken();
  const v4l2_buffer& buffer = argument.buffer;
  const int index = static_cast<int>(buffer.index);
  return std::optional<FilledBuffer>({.index = index,
                                      .data = argument.used(mapped_[buffer.index].bytes()),
                                      .sequence = buffer.sequence,
                                      .faulty = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0,
                                      .time = driverTime(buffer.flags, buffer.timestamp)});
}

Status Stream::enqueue(int index) {
  BufferArgument argument(*device_, index);
  if (device_->call(VIDIOC_QBUF, &argument.buffer) != 0) {
    return device_->error("giving buffer " + std::to_string(index) + " back");
  }
  buffers_.given();
  return success();
}

int Stream::dmaBuf(int index) const { return dma_bufs_[static_cast<std::size_t>(index)].get(); }

}  // namespace waymark::capture::v4l2
