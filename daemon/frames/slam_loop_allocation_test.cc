// The SLAM thread of the daemon takes no memory from the heap once it tracks steadily: frames of a
// simulated camera through the real queue and loop, with a counting operator new.
#include <chrono>
#include <memory>
#include <thread>
#include <utility>
#include <variant>

#include <gtest/gtest.h>

#include "daemon/frames/camera_status.h"
#include "daemon/frames/slam_loop.h"
#include "daemon/frames/slam_requests.h"
#include "simulator/live_source.h"
#include "slam/testing/counting_new.h"

namespace waymark::daemon {
namespace {

using waymark::testing::allocations;

// A camera, a SLAM loop on its own thread, and nobody else.
class Loop {
 public:
  Loop(simulator::LiveSimulatedSource& camera, const slam::Options& options, slam::Map map)
      : camera_(camera),
        requests_(frames_),
        slam_loop_(std::make_unique<slam::Slam>(slam::CameraModel(camera.camera()),
                                                *slam::Dictionary::byName("ARUCO_MIP_36h12"),
                                                options, std::move(map)),
                   frames_, status_, requests_, output_),
        thread_([this] { slam_loop_.run(); }) {}
  ~Loop() { close(); }
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  // Frames that got a pose.
  int feed(int frames) {
    int localized = 0;
    FrameRecord record;
    for (int i = 0; i < frames; ++i) {
      capture::ReadResult read = camera_.read(std::chrono::seconds(2));
      if (auto* const frame = std::get_if<capture::FramePtr>(&read))
        frames_.push(std::move(*frame));
      while (output_.records.try_dequeue(record)) localized += record.pose ? 1 : 0;
    }
    return localized;
  }
  // By the SLAM thread, up to now.
  int allocated() {
    int count = -1;
    EXPECT_TRUE(requests_.run([&](auto&) { count = allocations; }));
    return count;
  }
  slam::Map close() {
    if (!thread_.joinable()) return {};
    frames_.close();
    thread_.join();
    return slam_loop_.slam().map();
  }

 private:
  simulator::LiveSimulatedSource& camera_;
  FrameQueue frames_{4};
  SlamRequests requests_;
  CameraStatus status_;
  SlamOutput output_;
  SlamLoop slam_loop_;
  std::thread thread_;
};

TEST(SlamLoopAllocation, SteadyTrackingTakesNone) {
  simulator::LiveOptions options;
  options.simulation.scene = "walls";
  options.simulation.dictionary = "ARUCO_MIP_36h12";
  options.simulation.marker_size_m = 0.2;
  options.simulation.size = {320, 240};
  options.simulation.rate_hz = 60.0;
  options.loop_s = 1.0;
  const auto camera = simulator::openLive(options);
  ASSERT_TRUE(camera) << camera.error().message;

  slam::Options slam_options;
  slam_options.markers.size_m = 0.2;
  slam::Map map;
  {
    Loop mapping(**camera, slam_options, {});
    EXPECT_GT(mapping.feed(120), 60);
    EXPECT_GT(mapping.allocated(), 0) << "a map has to be somewhere";
    map = mapping.close();
  }
  slam_options.mapping = false;
  Loop localizing(**camera, slam_options, std::move(map));
  // The lens is asked for in the first seconds, from views that have to be kept.
  EXPECT_GT(localizing.feed(300), 150);
  const int before = localizing.allocated();
  EXPECT_GT(localizing.feed(120), 60);
  EXPECT_EQ(localizing.allocated(), before);
}

}  // namespace
}  // namespace waymark::daemon
