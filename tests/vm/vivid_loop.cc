#include "tests/vm/vivid_loop.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <random>
#include <span>
#include <utility>

#include <fcntl.h>
#include <linux/v4l2-dv-timings.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>

#include "base/system_reason.h"
#include "tests/process.h"

namespace waymark::testing {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr const char* kDriver = "/sys/bus/platform/drivers/vivid";
constexpr const char* kDevice = "vivid.0";
constexpr __u32 kBuffers = 3;  // on their way to the driver

UniqueFd openNode(const std::filesystem::path& path, int flags) {
  return UniqueFd(open(path.c_str(), flags | O_CLOEXEC));
}

Error failed(const std::filesystem::path& node, const char* what) {
  return {node.string() + ": " + what + ": " + systemReason()};
}

bool waitUntil(milliseconds timeout, const auto& condition) {
  const auto until = steady_clock::now() + timeout;
  while (!condition()) {
    if (steady_clock::now() > until) return false;
    std::this_thread::sleep_for(milliseconds(5));
  }
  return true;
}

// By its name, as `v4l2-ctl --list-ctrls` has it.
Status setControl(const std::filesystem::path& node, const std::string& name, int value) {
  const UniqueFd fd = openNode(node, O_RDWR);
  if (!fd) return failed(node, "open");
  v4l2_queryctrl query = {};
  query.id = V4L2_CTRL_FLAG_NEXT_CTRL;
  while (ioctl(fd.get(), VIDIOC_QUERYCTRL, &query) == 0) {
    if (name == reinterpret_cast<const char*>(query.name)) {
      v4l2_control control = {.id = query.id, .value = value};
      if (ioctl(fd.get(), VIDIOC_S_CTRL, &control) != 0) return failed(node, name.c_str());
      return success();
    }
    query.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
  }
  return Error{node.string() + ": no control '" + name + "'"};
}

Status setTimings(const std::filesystem::path& node) {
  const UniqueFd fd = openNode(node, O_RDWR);
  if (!fd) return failed(node, "open");
  v4l2_dv_timings timings = V4L2_DV_BT_DMT_640X480P60;
  if (ioctl(fd.get(), VIDIOC_S_DV_TIMINGS, &timings) != 0) return failed(node, "timings");
  return success();
}

Status setOutputFormat(const std::filesystem::path& node, PixelFormat pixels) {
  const UniqueFd fd = openNode(node, O_RDWR);
  if (!fd) return failed(node, "open");
  v4l2_format format = {};
  format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  v4l2_pix_format& pix = format.fmt.pix;
  if (ioctl(fd.get(), VIDIOC_G_FMT, &format) != 0) return failed(node, "format");
  pix.width = VividLoop::kWidth;
  pix.height = VividLoop::kHeight;
  pix.pixelformat = fourccOf(pixels);
  pix.field = V4L2_FIELD_NONE;
  pix.bytesperline = 0;
  if (ioctl(fd.get(), VIDIOC_S_FMT, &format) != 0) return failed(node, "format");
  if (pix.width != VividLoop::kWidth || pix.height != VividLoop::kHeight ||
      pix.pixelformat != fourccOf(pixels)) {
    return Error{node.string() + ": another format than " + nameOf(pixels)};
  }
  return success();
}

// Frames on their way into the output node; it takes them at its own rate. (Not by write(): the
// driver rejects it.)
class OutputStream {
 public:
  explicit OutputStream(const std::filesystem::path& node)
      : fd_(openNode(node, O_RDWR | O_NONBLOCK)) {
    v4l2_requestbuffers request = {};
    request.count = kBuffers;
    request.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    request.memory = V4L2_MEMORY_MMAP;
    if (!call(VIDIOC_REQBUFS, &request)) return;
    for (__u32 i = 0; i < std::min<__u32>(request.count, kBuffers); ++i) {
      v4l2_buffer buffer = describe(i);
      if (!call(VIDIOC_QUERYBUF, &buffer)) return;
      void* memory = mmap(nullptr, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED, fd_.get(),
                          buffer.m.offset);
      if (memory == MAP_FAILED) return;
      buffers_.emplace_back(static_cast<std::uint8_t*>(memory), buffer.length);
    }
  }
  OutputStream(const OutputStream&) = delete;
  OutputStream& operator=(const OutputStream&) = delete;
  ~OutputStream() {
    for (const auto& buffer : buffers_) munmap(buffer.data(), buffer.size());
  }

  // Waits for a free buffer; false when the stream is over, or nothing moves.
  [[nodiscard]] bool write(const Bytes& frame) {
    if (buffers_.empty()) return false;
    v4l2_buffer buffer = describe(queued_);
    if (queued_ == buffers_.size()) {
      pollfd poll_fd = {.fd = fd_.get(), .events = POLLOUT, .revents = 0};
      if (poll(&poll_fd, 1, 1000) != 1 || !call(VIDIOC_DQBUF, &buffer)) return false;
    } else {
      ++queued_;
    }
    const std::span<std::uint8_t> memory = buffers_[buffer.index];
    if (memory.size() != frame.size()) return false;
    std::ranges::copy(frame, memory.begin());
    buffer.bytesused = static_cast<__u32>(frame.size());
    buffer.field = V4L2_FIELD_NONE;
    if (!call(VIDIOC_QBUF, &buffer)) return false;
    if (queued_ < buffers_.size() || streaming_) return true;
    int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    return streaming_ = call(VIDIOC_STREAMON, &type);
  }

 private:
  static v4l2_buffer describe(std::size_t index) {
    v4l2_buffer buffer = {};
    buffer.index = static_cast<__u32>(index);
    buffer.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    buffer.memory = V4L2_MEMORY_MMAP;
    return buffer;
  }
  bool call(unsigned long request, void* argument) const {
    return ioctl(fd_.get(), request, argument) == 0;
  }

  UniqueFd fd_;
  std::vector<std::span<std::uint8_t>> buffers_;
  std::size_t queued_ = 0;  // until all have been
  bool streaming_ = false;
};

Status writeFile(const std::filesystem::path& path, const std::string& text) {
  std::ofstream stream(path);
  if (!(stream << text << std::flush)) return failed(path, "write");
  return success();
}

}  // namespace

const char* nameOf(PixelFormat format) {
  switch (format) {
    case PixelFormat::kGrey:
      return "GREY";
    case PixelFormat::kYuyv:
      return "YUYV";
    case PixelFormat::kNv12:
      return "NV12";
  }
  return "";
}

std::uint32_t fourccOf(PixelFormat format) {
  switch (format) {
    case PixelFormat::kGrey:
      return V4L2_PIX_FMT_GREY;
    case PixelFormat::kYuyv:
      return V4L2_PIX_FMT_YUYV;
    case PixelFormat::kNv12:
      return V4L2_PIX_FMT_NV12;
  }
  return 0;
}

Bytes encodeFrame(PixelFormat format, const ImageView& image, std::uint32_t seed) {
  std::mt19937 rng(seed);
  const auto pixels = static_cast<std::size_t>(image.width) * image.height;
  Bytes bytes;
  bytes.reserve(2 * pixels);
  for (int y = 0; y < image.height; ++y) {
    const std::uint8_t* row = image.row(y);
    for (int x = 0; x < image.width; ++x) {
      bytes.push_back(row[x]);
      if (format == PixelFormat::kYuyv) bytes.push_back(static_cast<std::uint8_t>(rng()));
    }
  }
  if (format == PixelFormat::kNv12) {
    for (std::size_t i = 0; i < pixels / 2; ++i) bytes.push_back(static_cast<std::uint8_t>(rng()));
  }
  return bytes;
}

VividLoop::~VividLoop() { stop(); }

Status VividLoop::prepare(PixelFormat format) {
  if (!std::filesystem::exists(std::filesystem::path(kDriver) / kDevice)) {
    // One capture and one output node, each with one HDMI connector, one buffer for all planes.
    const ProgramResult loaded =
        runProgram({"modprobe", "vivid", "n_devs=1", "node_types=0x101", "num_inputs=1",
                    "input_types=3", "num_outputs=1", "output_types=1", "multiplanar=1"});
    if (loaded.exit_code != 0) return Error{"modprobe vivid: " + loaded.err};
  }
  if (Status found = findNodes(); !found) return found;
  if (Status set = setTimings(output_); !set) return set;
  if (Status set = setOutputFormat(output_, format); !set) return set;
  if (Status set = setControl(capture_, "OSD Text Mode", 2); !set) return set;
  if (Status set = setControl(capture_, "Loop Video", 1); !set) return set;
  // Last: before this, the camera has another size, and nobody begins to read.
  return setTimings(capture_);
}

// The nodes have other numbers after each unplugging, perhaps.
Status VividLoop::findNodes() {
  const auto find = [](const std::string& name) -> std::filesystem::path {
    std::error_code none;
    for (const auto& entry : std::filesystem::directory_iterator("/sys/class/video4linux", none)) {
      std::string text = readFile(entry.path() / "name");
      if (text == name + "\n") return std::filesystem::path("/dev") / entry.path().filename();
    }
    return {};
  };
  const auto there = [&] {
    capture_ = find("vivid-000-vid-cap");
    output_ = find("vivid-000-vid-out");
    return !capture_.empty() && !output_.empty() && std::filesystem::exists(capture_) &&
           std::filesystem::exists(output_);
  };
  if (!waitUntil(milliseconds(10'000), there)) return Error{"vivid: its nodes do not appear"};
  return success();
}

bool VividLoop::play(std::vector<Bytes> frames) {
  stop();
  stop_ = false;
  written_ = 0;
  writer_ = std::thread([this, frames = std::move(frames)] { writeFrames(frames); });
  return waitUntil(milliseconds(10'000), [this] { return written_ > kBuffers; });
}

void VividLoop::stop() {
  stop_ = true;
  if (writer_.joinable()) writer_.join();
}

void VividLoop::writeFrames(const std::vector<Bytes>& frames) {
  std::size_t next = 0;
  while (!stop_) {
    OutputStream stream(output_);
    while (!stop_ && stream.write(frames[next])) {
      next = (next + 1) % frames.size();
      ++written_;
    }
    std::this_thread::sleep_for(milliseconds(20));
  }
}

Status VividLoop::failStreams() { return setControl(capture_, "Inject Fatal Streaming Error", 1); }

Status VividLoop::disconnect() { return setControl(capture_, "Disconnect", 1); }

Status VividLoop::unplug() { return writeFile(std::filesystem::path(kDriver) / "unbind", kDevice); }

Status VividLoop::plugIn() { return writeFile(std::filesystem::path(kDriver) / "bind", kDevice); }

}  // namespace waymark::testing
