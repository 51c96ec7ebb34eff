// Between the SLAM thread and the one that looks for natural markers (seed 2, section 3.1): one
// frame at a time goes there, as a copy of its image, and what was found in it comes back. Neither
// thread waits for the other on the frames' way, no driver's buffer is held, and what is copied has
// its place from the start.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <semaphore>
#include <span>
#include <vector>

#include "base/image_view.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "slam/late_result.h"
#include "slam/map/map.h"
#include "slam/natural/pictures/picture_relocalizer.h"
#include "slam/slam.h"

namespace waymark::daemon {

class RelocalizerLink {
 public:
  // More pictures in one frame are left out, and counted.
  static constexpr std::size_t kMostResults = 32;

  // What the other thread is to look at.
  struct Query {
    slam::RelocalizationQuery frame;
    std::vector<std::optional<slam::Transform>> T_w_m;  // where the map has them, by `ids`
    std::optional<slam::CameraModel> camera;            // the lens in use
  };

  // ids: of the pictures, in the relocalizer's order. Images will have this size, pixels.
  RelocalizerLink(std::vector<int> ids, int width, int height);

  // SLAM thread, before a frame: what was found in an earlier one, if it is there by now, and has
  // not been handed out yet. Valid until ask().
  [[nodiscard]] std::span<const slam::LateResult> hear();
  // SLAM thread, after hear(): the other one has nothing to do. It stays so until ask().
  [[nodiscard]] bool idle() const;
  // SLAM thread, when idle, after the frame: look at this. map_revision: equal ones stand for equal
  // maps.
  void ask(const slam::FrameInput& frame, const slam::FrameResult& result,
           const slam::CameraModel& camera, const slam::Map& map, std::uint64_t map_revision);
  // SLAM thread: another SLAM is in the place of the one that asked, and knows nothing of that.
  void forget() { ++generation_; }

  // The other thread: waits for a frame to look at; null when there will be none. Valid until
  // answer().
  [[nodiscard]] const Query* wait();
  // The other thread, once for each frame. As they will be read from a recording: poses are rounded
  // to what a quaternion keeps.
  void answer(std::span<const slam::LateResult> results);
  // The other thread, after answer(): takes no frame for so long, or until there is a stop.
  void rest(std::chrono::nanoseconds time);

  // Any thread.
  void requestStop();
  [[nodiscard]] std::uint64_t leftOut() const { return left_out_.load(std::memory_order_relaxed); }

 private:
  // Who may touch what is below.
  enum class Turn : int { kNobody, kOther, kSlam };

  [[nodiscard]] bool stopped() const { return stop_.load(std::memory_order_relaxed); }
  void followMap(const slam::Map& map, std::uint64_t revision);

  const std::vector<int> ids_;
  std::atomic<Turn> turn_{Turn::kNobody};
  std::atomic<bool> resting_{false};
  std::atomic<bool> stop_{false};
  std::counting_semaphore<> wake_{0};  // by one for each ask, and for a stop
  std::atomic<std::uint64_t> left_out_{0};

  // Of the SLAM thread.
  std::uint64_t generation_ = 0;
  std::uint64_t map_revision_ = ~std::uint64_t{0};

  std::vector<std::uint8_t> pixels_;
  Query query_;
  std::array<slam::LateResult, kMostResults> results_;
  std::size_t count_ = 0;
};

}  // namespace waymark::daemon
