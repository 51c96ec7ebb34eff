// A map worker with the SLAM loop that it serves. Tests only.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <random>
#include <thread>
#include <utility>

#include <gtest/gtest.h>

#include "capture/frame.h"
#include "daemon/maps/map_worker.h"
#include "slam/testing/synthetic.h"
#include "tests/temporary_directory.h"

namespace waymark::daemon::testing {

// A SLAM loop that begins with a map of eight markers and gets blank frames.
class MapWorkerFixture : public ::testing::Test {
 protected:
  static constexpr double kSize_m = 0.2;

  MapWorkerFixture() : pool_(camera_.width, camera_.height, 4) {
    settings_.dictionary = "4X4_50";
    settings_.options.markers.size_m = kSize_m;
    settings_.map.out = file_;
    settings_.map.save_interval_s = 0;
  }
  ~MapWorkerFixture() override { stop(); }

  slam::Map wallMap() {
    const auto wall = slam::testing::markerWall(2, 4, 0.5, &rng_);
    slam::Options options;
    options.markers.size_m = kSize_m;
    const slam::CameraModel camera(camera_);
    slam::Slam slam(camera, *slam::Dictionary::byName("4X4_50"), options);
    for (int i = 0; i < 20; ++i) {
      const auto T_w_c = slam::testing::lookAt({0.05 * i, 0.0, 0.02 * i}, {0.0, 3.0, 0.0});
      const auto seen = slam::testing::observeAll(camera, T_w_c, wall, kSize_m, 0.05, &rng_);
      slam.process({.time = {static_cast<std::uint64_t>(i), i * 33'000'000LL}, .detections = seen});
    }
    return slam.map();
  }

  void start(slam::Map map) {
    loop_ =
        std::make_unique<SlamLoop>(std::make_unique<slam::Slam>(slam::CameraModel(camera_),
                                                                *slam::Dictionary::byName("4X4_50"),
                                                                settings_.options, std::move(map)),
                                   frames_, camera_status_, requests_, output_);
    worker_ = std::make_unique<MapWorker>(settings_, camera_, requests_, output_, log_);
    loop_thread_ = std::thread([this] { loop_->run(); });
    worker_thread_ = std::thread([this] { worker_->run(); });
  }
  void stopLoop() {
    if (!loop_thread_.joinable()) return;
    frames_.close();
    loop_thread_.join();
  }
  void stop() {
    stopLoop();
    if (!worker_thread_.joinable()) return;
    worker_->requestStop();
    worker_thread_.join();
  }

  const waymark::testing::TemporaryDirectory directory_;
  const std::filesystem::path file_ = directory_ / "map.json";
  std::mt19937 rng_{7};
  slam::Calibration camera_ = slam::testing::testCalibration();
  io::SlamSettings settings_;
  capture::FramePool pool_;
  std::int64_t sequence_ = 0;
  FrameQueue frames_{2};
  SlamRequests requests_{frames_};
  SlamOutput output_;
  const CameraStatus camera_status_;
  Log log_{LogLevel::kError, false};
  std::unique_ptr<SlamLoop> loop_;
  std::unique_ptr<MapWorker> worker_;
  std::thread loop_thread_;
  std::thread worker_thread_;
};

}  // namespace waymark::daemon::testing
