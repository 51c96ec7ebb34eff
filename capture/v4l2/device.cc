#include "capture/v4l2/device.h"

#include <algorithm>
#include <cerrno>
#include <functional>
#include <utility>

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>

#include "base/system_reason.h"

namespace waymark::capture::v4l2 {
namespace {

// A driver that never comes to an end of its list is broken.
constexpr std::uint32_t kMaxEntries = 256;

// Fields of fixed length that need not end in a zero.
template <std::size_t size>
std::string text(const std::uint8_t (&field)[size]) {
  const auto* end = std::find(std::begin(field), std::end(field), std::uint8_t{0});
  return {std::begin(field), end};
}

double hertz(const v4l2_fract& interval) {
  return interval.numerator == 0
             ? 0.0
             : static_cast<double>(interval.denominator) / static_cast<double>(interval.numerator);
}

OfferedMode discreteMode(std::uint32_t fourcc, std::uint32_t width, std::uint32_t height) {
  const int w = static_cast<int>(width);
  const int h = static_cast<int>(height);
  return {.fourcc = fourcc,
          .min_width = w,
          .max_width = w,
          .min_height = h,
          .max_height = h,
          .rates_hz = {}};
}

OfferedMode steppedMode(std::uint32_t fourcc, const v4l2_frmsize_stepwise& range) {
  return {.fourcc = fourcc,
          .min_width = static_cast<int>(range.min_width),
          .max_width = static_cast<int>(range.max_width),
          .width_step = std::max(1, static_cast<int>(range.step_width)),
          .min_height = static_cast<int>(range.min_height),
          .max_height = static_cast<int>(range.max_height),
          .height_step = std::max(1, static_cast<int>(range.step_height)),
          .rates_hz = {}};
}

}  // namespace

Result<Device> Device::open(const std::string& path) {
  // O_NONBLOCK: waiting is poll()'s, which knows when to stop.
  UniqueFd fd(::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
  if (!fd) {
    const std::string hint = errno == EACCES ? " (is the user in the group video?)" : "";
    return Error{path + ": " + systemReason() + hint};
  }
  Device device(path, std::move(fd));
  if (const Status identified = device.identify(); !identified) return identified.error();
  return device;
}

Status Device::identify() {
  v4l2_capability capability{};
  if (call(VIDIOC_QUERYCAP, &capability) != 0) return Error{path_ + ": is no video device"};
  card_ = {.driver = text(capability.driver),
           .name = text(capability.card),
           .bus = text(capability.bus_info)};
  const std::uint32_t can = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0
                                ? capability.device_caps
                                : capability.capabilities;
  if ((can & V4L2_CAP_VIDEO_CAPTURE) != 0) {
    buffer_type_ = V4L2_BUF_TYPE_VIDEO_CAPTURE;
  } else if ((can & V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0) {
    buffer_type_ = V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
  } else {
    return Error{path_ + ": '" + card_.name + "' takes no pictures here"};
  }
  if ((can & V4L2_CAP_STREAMING) == 0) {
    return Error{path_ + ": '" + card_.name + "' does not stream its pictures"};
  }
  return success();
}

bool Device::multiplanar() const { return buffer_type_ == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE; }

int Device::call(unsigned long request, void* argument) const {
  int result = 0;
  do {
    result = ioctl(fd_.get(), request, argument);
  } while (result == -1 && errno == EINTR);
  return result;
}

Error Device::error(const std::string& what) const {
  return {path_ + ": " + what + ": " + systemReason()};
}

std::vector<OfferedMode> Device::modes() const {
  std::vector<OfferedMode> all;
  for (std::uint32_t i = 0; i < kMaxEntries; ++i) {
    v4l2_fmtdesc format{};
    format.index = i;
    format.type = buffer_type_;
    if (call(VIDIOC_ENUM_FMT, &format) != 0) break;
    std::ranges::move(sizes(format.pixelformat), std::back_inserter(all));
  }
  return all;
}

std::vector<OfferedMode> Device::sizes(std::uint32_t fourcc) const {
  std::vector<OfferedMode> all;
  for (std::uint32_t i = 0; i < kMaxEntries; ++i) {
    v4l2_frmsizeenum size{};
    size.index = i;
    size.pixel_format = fourcc;
    if (call(VIDIOC_ENUM_FRAMESIZES, &size) != 0) break;
    const bool discrete = size.type == V4L2_FRMSIZE_TYPE_DISCRETE;
    OfferedMode mode = discrete ? discreteMode(fourcc, size.discrete.width, size.discrete.height)
                                : steppedMode(fourcc, size.stepwise);
    mode.rates_hz = rates(fourcc, mode.max_width, mode.max_height);
    all.push_back(std::move(mode));
    if (!discrete) break;
  }
  // Receivers of other devices' pictures, HDMI and the like, do not list sizes: there is one.
  if (all.empty()) all.push_back(currentSize(fourcc));
  return all;
}

OfferedMode Device::currentSize(std::uint32_t fourcc) const {
  v4l2_format format{};
  format.type = buffer_type_;
  if (call(VIDIOC_G_FMT, &format) != 0) return discreteMode(fourcc, 0, 0);
  OfferedMode mode = multiplanar()
                         ? discreteMode(fourcc, format.fmt.pix_mp.width, format.fmt.pix_mp.height)
                         : discreteMode(fourcc, format.fmt.pix.width, format.fmt.pix.height);
  mode.rates_hz = rates(fourcc, mode.max_width, mode.max_height);
  return mode;
}

std::vector<double> Device::rates(std::uint32_t fourcc, int width, int height) const {
  std::vector<double> all;
  for (std::uint32_t i = 0; i < kMaxEntries; ++i) {
    v4l2_frmivalenum interval{};
    interval.index = i;
    interval.pixel_format = fourcc;
    interval.width = static_cast<std::uint32_t>(width);
    interval.height = static_cast<std::uint32_t>(height);
    if (call(VIDIOC_ENUM_FRAMEINTERVALS, &interval) != 0) break;
    if (interval.type != V4L2_FRMIVAL_TYPE_DISCRETE) {
      // Any rate in between will do as well: the driver is asked for it when it is set.
      all = {hertz(interval.stepwise.min), hertz(interval.stepwise.max)};
      break;
    }
    all.push_back(hertz(interval.discrete));
  }
  std::ranges::sort(all, std::greater<>());
  return all;
}

}  // namespace waymark::capture::v4l2
