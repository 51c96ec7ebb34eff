// A V4L2 camera read with nothing but the kernel's interface: what the driver says, without
// anybody's judgement in between. Tests only.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/unique_fd.h"
#include "tests/vm/uvc/bytes.h"

namespace waymark::testing {

struct V4l2Mode {
  std::uint32_t pixel_format = 0;  // V4L2_PIX_FMT_*
  int width = 0;                   // pixels
  int height = 0;                  // pixels
  int rate_hz = 0;
};

struct V4l2Frame {
  Bytes bytes;
  std::uint32_t sequence = 0;
  std::int64_t monotonic_ns = 0;
  bool error = false;  // V4L2_BUF_FLAG_ERROR
};

// An Error is the failed call and the system's reason; error_number() has the number.
class V4l2Reader {
 public:
  [[nodiscard]] static Result<std::unique_ptr<V4l2Reader>> open(const std::filesystem::path& node);
  V4l2Reader(const V4l2Reader&) = delete;
  V4l2Reader& operator=(const V4l2Reader&) = delete;
  ~V4l2Reader();

  // Every format with every size and rate on offer.
  [[nodiscard]] std::vector<V4l2Mode> modes() const;
  // "usb-vhci_hcd.0-1" and the like: where it is plugged in.
  [[nodiscard]] std::string busInfo() const;

  // V4L2_CID_*.
  [[nodiscard]] Status setControl(std::uint32_t id, std::int32_t value) const;
  [[nodiscard]] Result<std::int32_t> control(std::uint32_t id) const;

  // Sets the mode, as it is or not at all, and streams.
  [[nodiscard]] Status start(const V4l2Mode& mode);
  [[nodiscard]] Status stop();
  // The next frame.
  [[nodiscard]] Result<V4l2Frame> read(std::chrono::milliseconds timeout);

  // Of the call that failed last.
  [[nodiscard]] int errorNumber() const { return error_number_; }

 private:
  struct Mapping {
    void* address = nullptr;
    std::size_t bytes = 0;
  };

  explicit V4l2Reader(UniqueFd fd) : fd_(std::move(fd)) {}
  [[nodiscard]] Status setMode(const V4l2Mode& mode);
  [[nodiscard]] Status mapBuffers();
  void unmapBuffers();
  [[nodiscard]] Status call(unsigned long request, void* argument, const char* name) const;

  const UniqueFd fd_;
  std::vector<Mapping> buffers_;
  mutable int error_number_ = 0;
};

}  // namespace waymark::testing
