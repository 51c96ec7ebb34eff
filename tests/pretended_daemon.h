// Publishes what a daemon with a map would, without a camera or a SLAM. Tests only.
#pragma once

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <lcm/lcm.h>

#include "base/clock.h"
#include <waymark/detections_t.hpp>
#include <waymark/health_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/natural_detections_t.hpp>
#include <waymark/natural_map_t.hpp>
#include <waymark/pose_t.hpp>

namespace waymark::testing {

// With 48 markers and two natural ones, until it is taken away.
class PretendedDaemon {
 public:
  PretendedDaemon(const std::string& url, std::string prefix, double rate_hz = 60.0)
      : lcm_(lcm_create(url.c_str())),
        prefix_(std::move(prefix)),
        period_(static_cast<int>(1e6 / rate_hz)),
        thread_([this] { run(); }) {}
  ~PretendedDaemon() {
    stop_ = true;
    thread_.join();
    lcm_destroy(lcm_);
  }
  PretendedDaemon(const PretendedDaemon&) = delete;
  PretendedDaemon& operator=(const PretendedDaemon&) = delete;

  std::atomic<bool> no_camera{false};

 private:
  template <typename Message>
  void send(const char* channel, const Message& message) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    lcm_publish(lcm_, (prefix_ + channel).c_str(), bytes.data(),
                static_cast<unsigned>(bytes.size()));
  }

  void run() {
    const std::int64_t begin_ns = monotonicNs();
    for (int frame = 0; !stop_; ++frame) {
      sendPose(frame);
      sendDetections(frame);
      if (frame % 10 == 5) sendFound(frame);
      if (frame % 30 == 0) sendMap();
      if (frame % 30 == 0) sendNaturalMap();
      if (frame % 30 == 0) sendHealth(frame, monotonicNs() - begin_ns);
      std::this_thread::sleep_for(period_);
    }
  }

  void sendPose(int frame) {
    pose_t pose{};
    pose.sequence = frame;
    pose.monotonic_ns = monotonicNs();
    if (no_camera) {
      pose.status = pose_t::STATUS_NO_CAMERA;
      pose.reason = "/dev/video0: unplugged";
      return send("POSE", pose);
    }
    pose.status = pose_t::STATUS_TRACKING;
    pose.source = pose_t::SOURCE_MARKERS;
    pose.had_pose = 1;
    const double angle = 0.02 * frame;
    pose.p_w_c[0] = 1.2 * std::sin(angle);
    pose.p_w_c[1] = 0.1 * std::sin(3.0 * angle);
    pose.p_w_c[2] = 1.2 * std::cos(angle);
    pose.q_w_c[0] = std::cos(0.5 * angle);
    pose.q_w_c[2] = std::sin(0.5 * angle);
    pose.covariance[0] = pose.covariance[7] = pose.covariance[14] = 1e-6;
    pose.markers_used = 5;
    pose.reprojection_rms_px = 0.08;
    pose.latency_ns = 2'400'000 + 400'000 * (frame % 9);
    send("POSE", pose);
  }

  // On the four walls of a room.
  void sendMap() {
    map_t map{};
    map.revision = 3;
    map.piece_count = 1;
    map.dictionary = "ARUCO_MIP_36h12";
    map.count = map.marker_count = 48;
    map.keyframe_count = 118;
    for (int i = 0; i < 48; ++i) {
      marker_t marker{};
      marker.id = i;
      marker.size = 0.165;
      const double wall = 0.5 * M_PI * (i / 12);
      const double along = 0.5 * (i % 6) - 1.25;
      const double high = i % 12 < 6 ? -0.35 : 0.35;
      marker.p_w_m[0] = 2.5 * std::sin(wall) + along * std::cos(wall);
      marker.p_w_m[1] = high;
      marker.p_w_m[2] = 2.5 * std::cos(wall) - along * std::sin(wall);
      // Its face looks inwards: half a turn about x, then about y.
      marker.q_w_m[1] = std::cos(0.5 * wall);
      marker.q_w_m[3] = -std::sin(0.5 * wall);
      marker.state = i == 7 ? marker_t::STATE_UNDECIDED : marker_t::STATE_MAPPED;
      marker.views = 9 + i;
      marker.sigma_m = 0.002 + 0.0005 * i;
      map.markers.push_back(marker);
    }
    map.unposed_count = 1;
    map.unposed.resize(1);
    map.unposed[0].id = 99;
    map.unposed[0].state = unposed_marker_t::STATE_QUARANTINED;
    send("MAP", map);
  }

  // Two pictures between the rows of markers.
  void sendNaturalMap() {
    natural_map_t map{};
    map.revision = 3;
    map.piece_count = 1;
    map.count = map.marker_count = 2;
    map.markers.resize(2);
    for (int i = 0; i < 2; ++i) {
      natural_marker_t& marker = map.markers[static_cast<std::size_t>(i)];
      const double wall = 0.5 * M_PI * i;
      marker.id = kPicture + i;
      marker.name = i == 0 ? "poster" : "fire exit plan";
      marker.width = i == 0 ? 0.6 : 0.3;
      marker.height = 0.42;
      marker.p_w_m[0] = 2.5 * std::sin(wall);
      marker.p_w_m[2] = 2.5 * std::cos(wall);
      marker.q_w_m[1] = std::cos(0.5 * wall);
      marker.q_w_m[3] = -std::sin(0.5 * wall);
      marker.covariance[0] = marker.covariance[7] = marker.covariance[14] = 9e-6;
    }
    send("NATURAL_MAP", map);
  }

  // The first one, some frames ago.
  void sendFound(int frame) {
    natural_detections_t found{};
    found.sequence = frame;
    found.monotonic_ns = monotonicNs();
    found.count = 1;
    found.detections.resize(1);
    found.detections[0].sequence = frame - 3;
    found.detections[0].id = kPicture;
    found.detections[0].name = "poster";
    found.detections[0].p_m_c[2] = 1.3;
    found.detections[0].q_m_c[1] = 1.0;
    send("NATURAL", found);
  }

  void sendDetections(int frame) {
    detections_t detections{};
    detections.sequence = frame;
    detections.monotonic_ns = monotonicNs();
    detections.count = detections.seen = 3;
    for (int i = 0; i < 3; ++i) {
      const double x = 120.0 + 160.0 * i + 40.0 * std::sin(0.05 * frame);
      const double y = 150.0 + 40.0 * i;
      detections.detections.push_back(
          {i, i == 2 ? 1 : 0, {{x, y}, {x + 80, y + 6}, {x + 76, y + 84}, {x - 4, y + 78}}});
    }
    send("DETECTIONS", detections);
  }

  void sendHealth(int frame, std::int64_t uptime_ns) {
    health_t health{};
    health.uptime_ns = uptime_ns;
    health.version = "0.1.0";
    health.status = pose_t::STATUS_TRACKING;
    health.camera = health_t::CAMERA_RUNNING;
    health.frame_rate_hz = health.pose_rate_hz = 60.0;
    health.latency_median_ns = 2'600'000;
    health.latency_p99_ns = 5'000'000;
    health.latency_max_ns = 5'600'000;
    health.processing_median_ns = 900'000;
    health.processing_max_ns = 2'100'000;
    health.counters = {{"dropped.queue", frame / 30}, {"camera.frames", frame}};
    health.counter_count = 2;
    health.lens.width = 640;
    health.lens.height = 480;
    health.lens.fx = health.lens.fy = 500.0;
    health.lens.cx = 319.5;
    health.lens.cy = 239.5;
    send("HEALTH", health);
  }

  static constexpr int kPicture = 1 << 30;

  lcm_t* lcm_;
  const std::string prefix_;
  const std::chrono::microseconds period_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace waymark::testing
