#include "simulator/live_source.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "io/trajectory.h"
#include "tests/temporary_directory.h"

namespace waymark::simulator {
namespace {

using std::chrono::milliseconds;

LiveOptions smallCamera() {
  LiveOptions options;
  options.simulation.size = ImageSize{160, 120};
  options.simulation.rate_hz = 50.0;
  options.loop_s = 0.2;  // ten frames
  return options;
}

TEST(LiveSource, PlaysTheLoopInRealTime) {
  auto source = openLive(smallCamera());
  ASSERT_TRUE(source.ok());
  EXPECT_TRUE((*source)->info().live);
  EXPECT_EQ((*source)->info().frame_count, -1);
  std::map<std::uint64_t, std::vector<std::uint8_t>> loop;  // by sequence number
  std::int64_t first_ns = 0;
  for (int i = 0; i < 25; ++i) {
    auto result = (*source)->read(milliseconds(1000));
    auto* const frame = std::get_if<capture::FramePtr>(&result);
    ASSERT_NE(frame, nullptr);
    const capture::FrameStamp& stamp = (*frame)->stamp();
    EXPECT_GE(monotonicNs(), stamp.monotonic_ns);  // never before it is exposed
    if (i == 0)
      first_ns = stamp.monotonic_ns - static_cast<std::int64_t>(stamp.sequence) * 20000000;
    EXPECT_NEAR(static_cast<double>(stamp.monotonic_ns - first_ns),
                static_cast<double>(stamp.sequence) * 20e6, 2.0);
    const ImageView image = (*frame)->image();
    const std::ptrdiff_t pixels = std::ptrdiff_t{image.width} * image.height;
    loop[stamp.sequence].assign(image.data, image.data + pixels);
  }
  const capture::SourceCounters counters = (*source)->counters();
  EXPECT_EQ(counters.frames, 25U);
  EXPECT_EQ(counters.dropped_no_buffer, 0U);
  int repeated = 0;
  for (const auto& [sequence, image] : loop) {
    const auto later = loop.find(sequence + 10);
    if (later == loop.end()) continue;
    EXPECT_EQ(image, later->second);
    ++repeated;
  }
  EXPECT_GT(repeated, 0);
}

TEST(LiveSource, TimesOut) {
  LiveOptions options = smallCamera();
  options.simulation.rate_hz = 5.0;
  auto source = openLive(options);
  ASSERT_TRUE(source.ok());
  EXPECT_TRUE(std::holds_alternative<capture::FramePtr>((*source)->read(milliseconds(10))));
  EXPECT_TRUE(std::holds_alternative<capture::TimedOut>((*source)->read(milliseconds(10))));
}

TEST(LiveSource, DropsAndCountsWhatALateReaderMissed) {
  auto source = openLive(smallCamera());
  ASSERT_TRUE(source.ok());
  ASSERT_TRUE(std::holds_alternative<capture::FramePtr>((*source)->read(milliseconds(100))));
  std::this_thread::sleep_for(milliseconds(310));  // 15 frames; the driver keeps the last four
  auto result = (*source)->read(milliseconds(100));
  auto* const frame = std::get_if<capture::FramePtr>(&result);
  ASSERT_NE(frame, nullptr);
  const std::uint64_t dropped = (*source)->counters().dropped_late;
  EXPECT_GE(dropped, 11U);
  EXPECT_EQ((*frame)->stamp().sequence, dropped + 1);
}

TEST(LiveSource, CountsFramesLostForWantOfABuffer) {
  LiveOptions options = smallCamera();
  options.buffers = 1;
  auto source = openLive(options);
  ASSERT_TRUE(source.ok());
  {
    const auto held = (*source)->read(milliseconds(100));
    ASSERT_TRUE(std::holds_alternative<capture::FramePtr>(held));
    EXPECT_TRUE(std::holds_alternative<capture::TimedOut>((*source)->read(milliseconds(90))));
  }
  EXPECT_GE((*source)->counters().dropped_no_buffer, 4U);
  EXPECT_TRUE(std::holds_alternative<capture::FramePtr>((*source)->read(milliseconds(100))));
}

TEST(LiveSource, WritesTheTruthOfWhatItHandedOut) {
  const waymark::testing::TemporaryDirectory temporary;
  const std::filesystem::path directory = temporary / "truth";
  LiveOptions options = smallCamera();
  options.truth_directory = directory;
  std::vector<std::int64_t> utimes;
  std::vector<Eigen::Vector3d> positions;
  {
    auto source = openLive(options);
    ASSERT_TRUE(source.ok()) << source.error().message;
    EXPECT_TRUE(std::filesystem::exists(directory / "calib.yml"));
    EXPECT_TRUE(std::filesystem::exists(directory / "gt_map.json"));
    for (int i = 0; i < 12; ++i) {
      auto result = (*source)->read(milliseconds(1000));
      auto* const frame = std::get_if<capture::FramePtr>(&result);
      ASSERT_NE(frame, nullptr);
      utimes.push_back((*frame)->stamp().utime);
      positions.push_back((*source)->poseAt((*frame)->stamp().sequence).p);
    }
    EXPECT_TRUE((*source)->close().ok());
  }
  const Result<io::Trajectory> truth = io::readTrajectory(directory / "gt_traj.txt");
  ASSERT_TRUE(truth) << truth.error().message;
  ASSERT_EQ(truth->size(), utimes.size());
  for (std::size_t n = 0; n < truth->size(); ++n) {
    EXPECT_EQ((*truth)[n].time_ns, 1000 * utimes[n]);
    EXPECT_LT(((*truth)[n].T_w_c.p - positions[n]).norm(), 1e-8);
  }
}

TEST(LiveSource, SaysWhatIsWrong) {
  const auto reason = [](const LiveOptions& options) {
    const auto source = openLive(options);
    return source ? std::string() : source.error().message;
  };
  LiveOptions options = smallCamera();
  options.loop_s = 0.0;
  EXPECT_EQ(reason(options), "the loop must be longer than 0 and at most 3600 seconds");
  options = {};
  options.simulation.rate_hz = 1000.0;
  options.loop_s = 60.0;
  EXPECT_NE(reason(options).find("MB of memory"), std::string::npos);
  options = smallCamera();
  options.truth_directory = "/dev/null/truth";
  EXPECT_NE(reason(options).find("/dev/null/truth"), std::string::npos);
}

}  // namespace
}  // namespace waymark::simulator
