// vivid, the kernel's virtual video driver, as a camera that films what it is given: frames written
// to its output node come out of its capture node, bit by bit. Tests in the guest only.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "base/image_view.h"
#include "base/result.h"
#include "base/unique_fd.h"

namespace waymark::testing {

using Bytes = std::vector<std::uint8_t>;

enum class PixelFormat { kGrey, kYuyv, kNv12 };

[[nodiscard]] const char* nameOf(PixelFormat format);
[[nodiscard]] std::uint32_t fourccOf(PixelFormat format);

// The image as a camera of that format sends it. Colours are noise, so that they cannot be mistaken
// for anything else; the same `seed`, the same noise.
[[nodiscard]] Bytes encodeFrame(PixelFormat format, const ImageView& image, std::uint32_t seed);

// The driver's device and its two nodes. Frames are 640x480, 60 a second.
class VividLoop {
 public:
  static constexpr int kWidth = 640;   // pixels
  static constexpr int kHeight = 480;  // pixels

  // Loads the driver where it is not. One at a time.
  VividLoop() = default;
  VividLoop(const VividLoop&) = delete;
  VividLoop& operator=(const VividLoop&) = delete;
  ~VividLoop();

  // Connects output and capture; frames are sent in this format. Nobody may be streaming. Whoever
  // reads must ask for the same format, or gets noise.
  [[nodiscard]] Status prepare(PixelFormat format);

  // Sends the frames round and round, on a thread of its own, until stop(). Goes on after errors.
  // Frames are repeated and left out on their way: sender and reader have clocks of their own.
  // Returns when the first are on their way; false when the driver does not take them.
  [[nodiscard]] bool play(std::vector<Bytes> frames);
  void stop();

  [[nodiscard]] const std::filesystem::path& captureNode() const { return capture_; }

  // Faults. Every stream fails once, with EIO.
  [[nodiscard]] Status failStreams();
  // The nodes are gone until the last user has closed them.
  [[nodiscard]] Status disconnect();
  // The device is unplugged and plugged in; it forgets everything that was set.
  [[nodiscard]] Status unplug();
  [[nodiscard]] Status plugIn();

 private:
  [[nodiscard]] Status findNodes();
  void writeFrames(const std::vector<Bytes>& frames);

  std::filesystem::path capture_;
  std::filesystem::path output_;
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> written_{0};
  std::thread writer_;
};

}  // namespace waymark::testing
