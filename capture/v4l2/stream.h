// Pictures of a device in memory that the driver shares with us (MMAP streaming).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/unique_fd.h"
#include "capture/camera_buffers.h"
#include "capture/mid_exposure.h"
#include "capture/mode_choice.h"
#include "capture/v4l2/device.h"

namespace waymark::capture::v4l2 {

// A picture as the driver left it in one of the buffers.
struct FilledBuffer {
  int index = 0;
  std::span<const std::uint8_t> data;  // of the first plane, as far as it is filled
  std::uint32_t sequence = 0;          // the driver's own count
  bool faulty = false;                 // the driver says that the data are
  DriverTime time;
};

// Memory mapped from the driver.
class MappedBuffer {
 public:
  MappedBuffer() = default;
  MappedBuffer(void* address, std::size_t size) : address_(address), size_(size) {}
  MappedBuffer(MappedBuffer&& other) noexcept;
  MappedBuffer& operator=(MappedBuffer&& other) noexcept;
  ~MappedBuffer();

  [[nodiscard]] std::span<const std::uint8_t> bytes() const {
    return {static_cast<const std::uint8_t*>(address_), size_};
  }

 private:
  void* address_ = nullptr;
  std::size_t size_ = 0;
};

class Stream {
 public:
  // Sets the mode, which must come out as chosen, and has at least two buffers mapped. `device` is
  // used as long as the stream lives.
  [[nodiscard]] static Result<Stream> open(const Device& device, const ChosenMode& mode,
                                           int buffers);

  // Gives every buffer to the driver and begins.
  [[nodiscard]] Status start();

  // Until a picture may be there, at most `timeout`. False when the device reports an error; then
  // there is none unless dequeue() says otherwise.
  [[nodiscard]] bool wait(std::chrono::nanoseconds timeout) const;
  // The oldest picture that waits; empty when there is none. Its buffer is ours until enqueue().
  [[nodiscard]] Result<std::optional<FilledBuffer>> dequeue();
  [[nodiscard]] Status enqueue(int index);

  // Which of them the driver has; kept by start(), dequeue() and enqueue().
  [[nodiscard]] CameraBuffers& buffers() { return buffers_; }
  [[nodiscard]] const CameraBuffers& buffers() const { return buffers_; }
  // A buffer's memory as DMABUF, owned by the stream; -1 where the driver exports none.
  [[nodiscard]] int dmaBuf(int index) const;

  [[nodiscard]] std::ptrdiff_t stride() const { return stride_; }  // bytes; 0 when compressed
  [[nodiscard]] double rateHz() const { return rate_hz_; }         // 0 when the driver won't say
  [[nodiscard]] bool interlaced() const { return interlaced_; }

 private:
  explicit Stream(const Device& device) : device_(&device) {}
  [[nodiscard]] Status setFormat(const ChosenMode& mode);
  void setRate(const ChosenMode& mode);
  [[nodiscard]] Status requestBuffers(int count);
  [[nodiscard]] Status map(int index);
  void exportDmaBuf(int index);

  const Device* device_;
  std::vector<MappedBuffer> mapped_;
  std::vector<UniqueFd> dma_bufs_;
  std::ptrdiff_t stride_ = 0;
  double rate_hz_ = 0.0;
  bool interlaced_ = false;
  CameraBuffers buffers_;
};

}  // namespace waymark::capture::v4l2
