// What a daemon has said last, put together from its messages, as JSON for pages and programs.
// Messages come from the network, where anybody can send: nothing in them is believed to be sound.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <bot_core/pose_t.hpp>

#include "io/maps/map_parts.h"
#include "io/text/json_node.h"
#include "view/seen_markers.h"
#include <waymark/calibration_t.hpp>
#include <waymark/detections_t.hpp>
#include <waymark/health_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/natural_detections_t.hpp>
#include <waymark/natural_map_t.hpp>
#include <waymark/pose_t.hpp>
#include <waymark/preview_t.hpp>

namespace waymark::view {

// What changes together, and is sent together.
enum class Part : std::size_t {
  kLink,
  kPose,
  kMap,
  kHealth,
  kDetections,
  kPreview,
  kControl,
  kPlayback,
  kCalibration
};
inline constexpr std::size_t kParts = 9;

class LiveState {
 public:
  // Times are CLOCK_MONOTONIC, when a message was received.
  void add(const pose_t& pose, std::int64_t now_ns);
  void add(const map_t& part, std::int64_t now_ns);
  void add(const natural_map_t& part, std::int64_t now_ns);
  void add(const health_t& health, std::int64_t now_ns);
  void add(const detections_t& detections, std::int64_t now_ns);
  // Of earlier frames.
  void add(const natural_detections_t& found, std::int64_t now_ns);
  void add(const preview_t& preview, std::int64_t now_ns);
  // Of a camera that is being calibrated.
  void add(const calibration_t& calibration, std::int64_t now_ns);
  // Of the body that carries the camera.
  void add(const bot_core::pose_t& body, std::int64_t now_ns);
  void addMalformed() { ++malformed_; }
  // What the daemon's control socket says; null: nobody answers there.
  void setControl(io::Json status);
  // Why nothing can be received at all; empty: something can.
  void setFault(const std::string& fault);
  // Of a recording that is played: how far it is. Null: none is.
  void setPlayback(io::Json playback);
  // Nothing is gone, although nothing is heard.
  void keepAlive(std::int64_t now_ns) { heard_ns_ = now_ns; }
  // Time passes: a daemon that says nothing any more is gone.
  void tick(std::int64_t now_ns);

  // Grows whenever text() of the part would be another one.
  [[nodiscard]] std::uint64_t version(Part part) const {
    return versions_[static_cast<std::size_t>(part)];
  }
  // One JSON object, with a "type".
  [[nodiscard]] std::string text(Part part) const;
  // Where the camera has been, for who comes late: {"type":"trail", ...}.
  [[nodiscard]] std::string trailText() const;
  // Everything, but the trail.
  [[nodiscard]] std::string stateText() const;
  // The lens in use, for camera.calibration; empty: nothing is known of it.
  [[nodiscard]] std::optional<std::string> calibrationFile() const;
  // For Prometheus.
  [[nodiscard]] std::string metricsText() const;

 private:
  // Of either kind of marker.
  template <typename Message>
  io::PartAdded addPart(const Message& part, std::int64_t now_ns, io::MapParts<Message>* map);

  // Of one of the last frames, for the preview that comes later.
  struct SeenFrame {
    detections_t detections;
    std::optional<pose_t> pose;
  };
  struct TrailPoint {
    std::array<float, 3> p;
    std::int64_t sequence;
    std::int8_t source;
    bool begins;  // something is missing before it
  };

  void changed(Part part) { ++versions_[static_cast<std::size_t>(part)]; }
  void addToTrail(const pose_t& pose);
  void forgetSession();
  [[nodiscard]] io::Json link() const;
  // Points as [sequence, x, y, z, source, begins]; with each pose, for pages that were not ready
  // for those before.
  [[nodiscard]] io::Json endOfTrail(std::size_t most) const;
  [[nodiscard]] io::Json pose() const;
  [[nodiscard]] io::Json map() const;
  [[nodiscard]] io::Json health() const;
  [[nodiscard]] io::Json detections() const;
  [[nodiscard]] io::Json preview() const;
  [[nodiscard]] io::Json calibration() const;
  // What was seen in a frame, markers and pictures.
  void tellSeen(const SeenFrame& frame, io::Json* json) const;
  [[nodiscard]] io::Json part(Part which) const;

  std::array<std::uint64_t, kParts> versions_{};
  std::string fault_;
  bool alive_ = false;
  std::int64_t heard_ns_ = 0;
  std::uint64_t malformed_ = 0;

  std::optional<pose_t> pose_;
  std::uint64_t poses_ = 0;    // messages with a frame behind them
  std::uint64_t missing_ = 0;  // frames between them of which nothing came
  // Latencies of poses: how many up to each of kLatencyBounds_ms, and beyond; of this half minute
  // and the one before.
  static constexpr std::array<double, 11> kLatencyBounds_ms = {0.5, 1,  2,  3,  5,  7,
                                                               10,  15, 20, 50, 100};
  std::array<std::array<std::uint64_t, kLatencyBounds_ms.size() + 1>, 2> latencies_{};
  std::int64_t histogram_since_ns_ = 0;

  io::MapParts<map_t> map_;
  io::MapParts<natural_map_t> natural_map_;
  std::optional<health_t> health_;
  std::map<std::string, std::int64_t> counters_before_;  // when this daemon was first heard
  std::deque<SeenFrame> seen_;  // of the last frames, the newest at the end
  FoundPictures found_;
  std::optional<preview_t> preview_;
  std::optional<calibration_t> calibration_;
  std::int64_t calibrated_ns_ = 0;  // when that came
  std::optional<bot_core::pose_t> body_;
  io::Json control_;
  io::Json playback_;
  std::vector<TrailPoint> trail_;
  std::int64_t trail_sequence_ = 0;
  std::int32_t trail_piece_ = 0;  // of the map, whose world the trail is in
};

}  // namespace waymark::view
