// A video device file: who it is and what it offers. Errors name the device, what was asked of the
// driver and the system's reason.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/unique_fd.h"
#include "capture/mode_choice.h"

namespace waymark::capture::v4l2 {

// What the driver says of itself (VIDIOC_QUERYCAP).
struct Card {
  std::string driver;  // "uvcvideo"
  std::string name;    // of the camera, as its maker calls it
  std::string bus;     // where it is plugged in: "usb-0000:00:14.0-1"
};

class Device {
 public:
  // Devices that take no pictures, or do not stream them, are errors.
  [[nodiscard]] static Result<Device> open(const std::string& path);

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const Card& card() const { return card_; }
  [[nodiscard]] int fd() const { return fd_.get(); }
  // The buffer type of its pictures: V4L2_BUF_TYPE_VIDEO_CAPTURE or ..._CAPTURE_MPLANE.
  [[nodiscard]] std::uint32_t bufferType() const { return buffer_type_; }
  [[nodiscard]] bool multiplanar() const;

  // Every format, size and rate, in the driver's order, also formats that we cannot read.
  [[nodiscard]] std::vector<OfferedMode> modes() const;

  // ioctl(), again when a signal came in between. -1 with errno as usual.
  [[nodiscard]] int call(unsigned long request, void* argument) const;

  // "PATH: WHAT: reason", of errno.
  [[nodiscard]] Error error(const std::string& what) const;

 private:
  Device(std::string path, UniqueFd fd) : path_(std::move(path)), fd_(std::move(fd)) {}
  [[nodiscard]] Status identify();
  [[nodiscard]] std::vector<OfferedMode> sizes(std::uint32_t fourcc) const;
  [[nodiscard]] OfferedMode currentSize(std::uint32_t fourcc) const;
  [[nodiscard]] std::vector<double> rates(std::uint32_t fourcc, int width, int height) const;

  std::string path_;
  UniqueFd fd_;
  Card card_;
  std::uint32_t buffer_type_ = 0;
};

}  // namespace waymark::capture::v4l2
