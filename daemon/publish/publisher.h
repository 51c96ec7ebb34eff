// The publisher thread: everything that waymarkd tells the world leaves through here.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "daemon/configuration.h"
#include "daemon/frames/camera_status.h"
#include "daemon/frames/slam_loop.h"
#include "daemon/frames/triple_buffer.h"
#include "daemon/health/counter_source.h"
#include "daemon/health/frame_statistics.h"
#include "daemon/publish/body_motion.h"
#include "daemon/publish/lcm_link.h"
#include "daemon/publish/messages.h"
#include "daemon/publish/natural_messages.h"
#include <waymark/health_t.hpp>

namespace waymark::daemon {

class Publisher {
 public:
  // `dictionary` is its name, for subscribers. Health messages are also left in `health`.
  Publisher(const Configuration::Publish& options, const BodyMotion::Options& body,
            std::string dictionary, SlamOutput& input, const CameraStatus& camera,
            const FrameQueue& frames, TripleBuffer<health_t>& health, const Log& log);

  // Every message goes there as well, encoded, whether or not it can be sent. Before run().
  using MessageTap = std::function<void(std::string_view channel,
                                        std::span<const std::uint8_t> bytes, std::int64_t utime)>;
  void setTap(MessageTap tap) { tap_ = std::move(tap); }
  // Counters of others for the health messages. Before run().
  void addCounters(CounterSource counters) { others_.push_back(std::move(counters)); }

  // The natural markers that subscribers are told of; without any, there are no such messages.
  // Before run().
  void setPrints(PrintsById prints) { prints_ = std::move(prints); }

  // Any thread: whether detections are published, from the next frame on.
  void setDetections(bool wanted) { detections_wanted_.store(wanted, std::memory_order_relaxed); }
  [[nodiscard]] bool detections() const {
    return detections_wanted_.load(std::memory_order_relaxed);
  }

  // The thread's body. Returns when the SLAM loop has finished and all it left is sent.
  void run();

 private:
  // Messages of any kind that did not leave, by cause.
  struct Unsent {
    std::uint64_t link_down = 0;
    std::uint64_t too_large = 0;
  };

  void publishFrame();
  void publishJoints();
  void publishNaturalDetections();
  void publishMap(std::int64_t now_ns);
  void watchCamera(std::int64_t now_ns);
  void publishNoCamera(std::int64_t now_ns);
  void publishHealthWhenDue(std::int64_t now_ns);
  void publishHealth(std::int64_t now_ns);
  void fillCounters();
  void addCounter(std::string name, std::uint64_t value);

  // False when it did not leave; then it is counted in unsent_.
  template <typename Message>
  bool send(const std::string& channel, const Message& message);

  // LCM loses larger messages in the field.
  static constexpr std::size_t kMaxMessageBytes = 60'000;

  const Configuration::Publish options_;
  std::atomic<bool> detections_wanted_;
  const std::string dictionary_;
  const std::string pose_channel_, detections_channel_, map_channel_, health_channel_;
  const std::string natural_detections_channel_, natural_map_channel_, joint_channel_;
  SlamOutput& input_;
  const CameraStatus& camera_;
  const FrameQueue& frames_;
  TripleBuffer<health_t>& health_out_;
  std::vector<CounterSource> others_;
  MessageTap tap_;
  PrintsById prints_;
  LcmLink link_;
  const std::int64_t started_ns_;

  // Kept from frame to frame, so that their memory is.
  FrameRecord record_;
  pose_t pose_{};
  detections_t detections_{};
  map_t map_{};
  natural_detections_t natural_detections_{};
  natural_map_t natural_map_{};
  joint_t joint_{};
  health_t health_{};
  bot_core::pose_t bot_core_pose_{};
  std::array<std::uint8_t, kMaxMessageBytes> bytes_{};

  BodyMotion body_;
  FrameStatistics statistics_;
  Unsent unsent_;
  std::uint64_t poses_sent_ = 0;                                       // of frames
  std::uint64_t poses_unsent_ = 0;                                     // of frames
  std::array<std::uint64_t, kFrameStages.size()> deadlines_missed_{};  // by the longest stage
  std::optional<std::int64_t> last_pose_ns_;                           // monotonic
  const MapSnapshot* newest_map_ = nullptr;  // of input_.map; null: none yet
  std::int64_t map_revision_ = 0;
  std::int64_t next_map_ns_ = 0;  // monotonic, when the same is sent again

  CameraStatus::Report camera_report_{CameraState::kOpening, "the camera is being opened"};
  std::uint32_t camera_version_ = 0;
  std::int64_t next_no_camera_ns_ = 0;  // monotonic
  bool health_changed_ = true;
};

}  // namespace waymark::daemon
