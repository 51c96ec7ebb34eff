#include "daemon/publish/publisher.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "tests/multicast.h"
#include "tests/subscriber.h"

namespace waymark::daemon {
namespace {

using std::chrono::milliseconds;
using waymark::testing::Received;
using waymark::testing::Subscriber;

constexpr milliseconds kPatience(10'000);
constexpr std::int64_t kSecond_ns = 1'000'000'000;

// A publisher whose SLAM loop and camera are the test, and a subscriber on the network.
class PublisherTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!waymark::testing::ensureMulticastRoute()) {
      GTEST_SKIP() << "no multicast route, and none may be made";
    }
    options_.url = waymark::testing::randomUrl();
    options_.channel_prefix = "TEST_";
    subscriber_ = std::make_unique<Subscriber>(options_.url, options_.channel_prefix);
    makePublisher();
  }
  void TearDown() override { finish(); }

  void makePublisher() {
    publisher_ = std::make_unique<Publisher>(options_, BodyMotion::Options{}, "4X4_50", output_,
                                             camera_, frames_, health_, log_);
  }
  void start() {
    thread_ = std::thread([this] { publisher_->run(); });
  }
  void finish() {
    output_.finished = true;
    if (thread_.joinable()) thread_.join();
  }

  static FrameRecord without(std::uint64_t sequence, slam::TrackingState state,
                             slam::NoPoseReason reason) {
    FrameRecord record;
    record.stamp.sequence = sequence;
    record.stamp.monotonic_ns = monotonicNs();
    record.stamp.utime = 1'700'000'000'000'000 + static_cast<std::int64_t>(sequence);
    record.state = state;
    record.reason = reason;
    record.seen = 1;
    record.markers[0].id = 7;
    return record;
  }
  static FrameRecord localized(std::uint64_t sequence) {
    FrameRecord record =
        without(sequence, slam::TrackingState::kTracking, slam::NoPoseReason::kNone);
    record.pose.emplace();
    record.pose->T_w_c.p = {1.0, 2.0, static_cast<double>(sequence)};
    record.pose->covariance = 1e-6 * slam::Matrix6d::Identity();
    record.pose->source = slam::PoseSource::kMarkers;
    return record;
  }
  void give(const FrameRecord& record) { ASSERT_TRUE(output_.records.try_enqueue(record)); }
  void giveMap(int markers) {
    MapSnapshot& map = output_.map.writeBuffer();
    map.markers.assign(static_cast<std::size_t>(markers), {.id = 3, .size_m = 0.1, .T_w_m = {}});
    map.keyframe_count = 12;
    output_.map.publish();
  }

  [[nodiscard]] bool comes(const std::function<bool(const Received&)>& condition) const {
    return subscriber_->waitFor(condition, kPatience);
  }
  // What has been received when the publisher has said its last word.
  [[nodiscard]] Received allOfIt() {
    finish();
    const health_t* last = health_.take();
    EXPECT_NE(last, nullptr);
    const std::int64_t last_ns = last == nullptr ? 0 : last->monotonic_ns;
    EXPECT_TRUE(comes([&](const Received& r) {
      return !r.healths.empty() && r.healths.back().monotonic_ns == last_ns;
    }));
    return subscriber_->received();
  }

  Configuration::Publish options_;
  SlamOutput output_;
  CameraStatus camera_;
  FrameQueue frames_{2};
  TripleBuffer<health_t> health_;
  const Log log_{LogLevel::kError, false};
  std::unique_ptr<Subscriber> subscriber_;
  std::unique_ptr<Publisher> publisher_;
  std::thread thread_;
};

TEST_F(PublisherTest, AFrameWithAPoseIsToldOnThreeChannels) {
  camera_.report(CameraState::kRunning, "");
  start();
  FrameRecord record = localized(5);
  record.stamp.monotonic_ns -= 5'000'000;
  give(record);
  ASSERT_TRUE(comes([](const Received& r) { return !r.detections.empty(); }));
  const Received all = allOfIt();
  ASSERT_EQ(all.poses.size(), 1U);
  EXPECT_EQ(all.poses[0].sequence, 5);
  EXPECT_EQ(all.poses[0].status, pose_t::STATUS_TRACKING);
  EXPECT_EQ(all.poses[0].p_w_c[2], 5.0);
  EXPECT_EQ(all.poses[0].last_pose_age_ns, 0);
  EXPECT_GE(all.poses[0].latency_ns, 5'000'000);
  ASSERT_EQ(all.bot_core_poses.size(), 1U);
  EXPECT_EQ(all.bot_core_poses[0].utime, record.stamp.utime);
  EXPECT_EQ(all.bot_core_poses[0].pos[2], 5.0);
  ASSERT_EQ(all.detections.size(), 1U);
  EXPECT_EQ(all.detections[0].sequence, 5);
  EXPECT_EQ(all.detections[0].dictionary, "4X4_50");
  ASSERT_EQ(all.detections[0].count, 1);
  EXPECT_EQ(all.detections[0].detections[0].id, 7);
  EXPECT_EQ(all.undecodable, 0);
}

TEST_F(PublisherTest, AFrameWithoutAPoseSaysWhyAndHowOldTheLastOneIs) {
  camera_.report(CameraState::kRunning, "");
  start();
  give(without(0, slam::TrackingState::kInitializing, slam::NoPoseReason::kNoMap));
  const FrameRecord seen = localized(1);
  give(seen);
  FrameRecord lost =
      without(2, slam::TrackingState::kRelocalizing, slam::NoPoseReason::kNoKnownMarker);
  lost.stamp.monotonic_ns = seen.stamp.monotonic_ns + 40'000'000;
  give(lost);
  ASSERT_TRUE(comes([](const Received& r) { return r.detections.size() == 3; }));
  const Received all = allOfIt();
  ASSERT_EQ(all.poses.size(), 3U);
  EXPECT_EQ(all.poses[0].status, pose_t::STATUS_INITIALIZING);
  EXPECT_EQ(all.poses[0].reason, slam::describe(slam::NoPoseReason::kNoMap));
  EXPECT_FALSE(all.poses[0].had_pose);
  EXPECT_EQ(all.poses[2].status, pose_t::STATUS_RELOCALIZING);
  EXPECT_EQ(all.poses[2].reason, slam::describe(slam::NoPoseReason::kNoKnownMarker));
  EXPECT_EQ(all.poses[2].source, pose_t::SOURCE_NONE);
  EXPECT_TRUE(all.poses[2].had_pose);
  EXPECT_EQ(all.poses[2].last_pose_age_ns, 40'000'000);
  EXPECT_EQ(all.bot_core_poses.size(), 1U) << "which cannot say that there is none";
}

TEST_F(PublisherTest, DetectionsAreLeftOutFromTheFrameOnThatNobodyWantsThem) {
  camera_.report(CameraState::kRunning, "");
  start();
  give(localized(0));
  ASSERT_TRUE(comes([](const Received& r) { return r.detections.size() == 1; }));
  publisher_->setDetections(false);
  EXPECT_FALSE(publisher_->detections());
  give(localized(1));
  ASSERT_TRUE(comes([](const Received& r) { return r.poses.size() == 2; }));
  publisher_->setDetections(true);
  give(localized(2));
  ASSERT_TRUE(comes([](const Received& r) { return r.detections.size() == 2; }));
  EXPECT_EQ(allOfIt().detections[1].sequence, 2);
}

TEST_F(PublisherTest, WhatIsLeftAtTheEndIsSent) {
  camera_.report(CameraState::kEnded, "");
  for (std::uint64_t i = 0; i < 40; ++i) give(localized(i));
  giveMap(2);
  output_.finished = true;
  start();
  const Received all = allOfIt();
  ASSERT_EQ(all.poses.size(), 40U);
  for (std::size_t i = 0; i < 40; ++i) {
    EXPECT_EQ(all.poses[i].sequence, static_cast<std::int64_t>(i));
  }
  EXPECT_EQ(all.maps.size(), 1U);
  EXPECT_EQ(all.counters()["published.poses"], 40);
  EXPECT_EQ(all.healths.back().camera, health_t::CAMERA_ENDED);
}

// Whoever subscribes late gets a map that does not change any more, also without frames.
TEST_F(PublisherTest, AMapThatStaysAsItIsIsSentAgain) {
  options_.map_interval_s = 0.1;
  makePublisher();
  start();
  giveMap(280);  // two parts
  ASSERT_TRUE(comes([](const Received& r) { return r.maps.size() >= 6; }));
  const Received all = allOfIt();
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(all.maps[i].revision, 1) << "it is the same";
    EXPECT_EQ(all.maps[i].piece, static_cast<int>(i % 2));
    EXPECT_EQ(all.maps[i].marker_count, 280);
  }
}

TEST_F(PublisherTest, AMapComesInPiecesOfOneRevision) {
  start();
  giveMap(250);
  ASSERT_TRUE(comes([](const Received& r) { return r.maps.size() == 2; }));
  giveMap(1);
  ASSERT_TRUE(comes([](const Received& r) { return r.maps.size() == 3; }));
  const Received all = allOfIt();
  int markers = 0;
  for (int piece = 0; piece < 2; ++piece) {
    const map_t& map = all.maps[static_cast<std::size_t>(piece)];
    EXPECT_EQ(map.revision, 1);
    EXPECT_EQ(map.piece, piece);
    EXPECT_EQ(map.piece_count, 2);
    EXPECT_EQ(map.marker_count, 250);
    EXPECT_EQ(map.keyframe_count, 12);
    markers += map.count;
  }
  EXPECT_EQ(markers, 250);
  EXPECT_EQ(all.maps[2].revision, 2);
  EXPECT_EQ(all.maps[2].piece_count, 1);
}

TEST_F(PublisherTest, AJointIsToldBeforeThePoseWhoseCoordinatesAreOtherOnes) {
  camera_.report(CameraState::kRunning, "");
  start();
  FrameRecord before = localized(4);
  before.map_piece = before.pose->piece = 3;
  give(before);
  FrameRecord record = localized(5);
  record.map_piece = record.pose->piece = 1;
  record.piece_events = 1;
  record.events[0] = {slam::PieceEvent::Kind::kJoined, 3, 1, {}, slam::Matrix6d::Identity()};
  record.events[0].T_into_piece.p = {1.0, 2.0, 3.0};
  output_.map_pieces = 2;
  give(record);
  ASSERT_TRUE(comes([](const Received& r) { return r.poses.size() == 2; }));
  ASSERT_TRUE(comes([](const Received& r) { return r.joints.size() == 1; }));
  const Received all = allOfIt();
  EXPECT_EQ(all.poses[0].map_piece, 3);
  EXPECT_EQ(all.poses[1].map_piece, 1);
  EXPECT_EQ(all.joints[0].kind, joint_t::KIND_JOINED);
  EXPECT_EQ(all.joints[0].sequence, 5);
  EXPECT_EQ(all.joints[0].map_piece, 3);
  EXPECT_EQ(all.joints[0].into, 1);
  EXPECT_EQ(all.joints[0].p_into_piece[2], 3.0);
  EXPECT_EQ(all.healths.back().map_piece, 1);
  EXPECT_EQ(all.healths.back().map_piece_count, 2);
  EXPECT_EQ(all.undecodable, 0);
}

// --- Health --------------------------------------------------------------------------------------

TEST_F(PublisherTest, HealthComesOnceASecondWhileNothingChanges) {
  camera_.report(CameraState::kRunning, "");
  start();
  std::this_thread::sleep_for(milliseconds(2500));
  const std::vector<health_t> healths = allOfIt().healths;
  ASSERT_GE(healths.size(), 4U);  // at 0, 1 and 2 s, and at the end
  ASSERT_LE(healths.size(), 5U);
  for (std::size_t i = 1; i + 1 < healths.size(); ++i) {
    EXPECT_GE(healths[i].monotonic_ns - healths[i - 1].monotonic_ns, kSecond_ns);
    EXPECT_EQ(healths[i].uptime_ns - healths[i - 1].uptime_ns,
              healths[i].monotonic_ns - healths[i - 1].monotonic_ns);
  }
}

TEST_F(PublisherTest, HealthComesAtOnceWhenStatusOrCameraChange) {
  camera_.report(CameraState::kRunning, "");
  start();
  const auto health_saying = [&](const std::function<bool(const health_t&)>& what) {
    EXPECT_TRUE(
        comes([&](const Received& r) { return !r.healths.empty() && what(r.healths.back()); }));
    const std::vector<health_t> healths = subscriber_->received().healths;
    return healths.size() < 2
               ? kSecond_ns
               : healths.back().monotonic_ns - std::prev(healths.end(), 2)->monotonic_ns;
  };
  (void)health_saying([](const health_t& h) { return h.camera == health_t::CAMERA_RUNNING; });
  give(localized(0));
  EXPECT_LT(health_saying([](const health_t& h) { return h.status == pose_t::STATUS_TRACKING; }),
            kSecond_ns);
  give(without(1, slam::TrackingState::kRelocalizing, slam::NoPoseReason::kNoMarker));
  EXPECT_LT(health_saying([](const health_t& h) { return h.reason == "no marker in view"; }),
            kSecond_ns);
  camera_.report(CameraState::kLost, "unplugged");
  EXPECT_LT(health_saying([](const health_t& h) { return h.camera_reason == "unplugged"; }),
            kSecond_ns);
  EXPECT_EQ(allOfIt().healths.back().camera, health_t::CAMERA_LOST);
}

TEST_F(PublisherTest, AFlickeringStatusDoesNotFloodTheNetwork) {
  camera_.report(CameraState::kRunning, "");
  start();
  for (std::uint64_t i = 0; i < 50; ++i) {
    give(i % 2 == 0
             ? localized(i)
             : without(i, slam::TrackingState::kRelocalizing, slam::NoPoseReason::kNoMarker));
    std::this_thread::sleep_for(milliseconds(5));
  }
  const std::vector<health_t> healths = allOfIt().healths;
  ASSERT_GE(healths.size(), 4U);
  for (std::size_t i = 1; i + 1 < healths.size(); ++i) {
    EXPECT_GE(healths[i].monotonic_ns - healths[i - 1].monotonic_ns, 50'000'000);
  }
}

TEST_F(PublisherTest, WithoutACameraPosesSayThatThereIsNoneOnceASecond) {
  camera_.report(CameraState::kRunning, "");
  start();
  give(localized(4));
  ASSERT_TRUE(comes([](const Received& r) { return r.poses.size() == 1; }));
  camera_.report(CameraState::kLost, "unplugged");
  ASSERT_TRUE(comes([](const Received& r) { return r.poses.size() == 3; }));
  camera_.report(CameraState::kRunning, "");
  ASSERT_TRUE(comes([](const Received& r) { return r.healths.back().camera_reason.empty(); }));
  const std::size_t before = subscriber_->received().poses.size();
  std::this_thread::sleep_for(milliseconds(1300));
  const Received all = allOfIt();
  EXPECT_EQ(all.poses.size(), before) << "there is one again";
  for (std::size_t i = 1; i < before; ++i) {
    EXPECT_EQ(all.poses[i].status, pose_t::STATUS_NO_CAMERA);
    EXPECT_EQ(all.poses[i].reason, "unplugged");
    EXPECT_EQ(all.poses[i].sequence, 4) << "the last frame's";
    EXPECT_GT(all.poses[i].last_pose_age_ns, 0);
  }
  EXPECT_GE(all.poses[2].monotonic_ns - all.poses[1].monotonic_ns, kSecond_ns);
  std::map<std::string, std::int64_t> counters = all.counters();
  EXPECT_EQ(counters["published.poses"], 1) << "of frames";
}

// --- Counters ------------------------------------------------------------------------------------

TEST_F(PublisherTest, HealthCarriesEverybodysCounters) {
  capture::SourceCounters source;
  source.frames = 100;
  source.dropped_gap = 4;
  camera_.count(source);
  camera_.countReopened();
  camera_.setRejected(2);
  output_.records_lost = 3;
  publisher_->addCounters([](const CounterSink& sink) { sink("recorder.events", 77); });
  FrameRecord late = localized(0);
  late.missed_deadline_in = static_cast<std::size_t>(slam::Stage::kTrack);
  late.counters.frames = 12;
  give(late);
  late.missed_deadline_in = static_cast<std::size_t>(slam::Stage::kMap);
  late.counters.frames = 13;
  give(late);
  give(without(1, slam::TrackingState::kRelocalizing, slam::NoPoseReason::kNoMarker));
  output_.finished = true;
  start();
  std::map<std::string, std::int64_t> counters = allOfIt().counters();
  EXPECT_EQ(counters["camera.frames"], 100);
  EXPECT_EQ(counters["dropped.source_gap"], 4);
  EXPECT_EQ(counters["camera.reopened"], 1);
  EXPECT_EQ(counters["camera.options_refused"], 2);
  EXPECT_EQ(counters["dropped.publisher"], 3);
  EXPECT_EQ(counters["recorder.events"], 77);
  EXPECT_EQ(counters["deadline.missed"], 2);
  EXPECT_EQ(counters["deadline.missed_track"], 1);
  EXPECT_EQ(counters["deadline.missed_map"], 1);
  EXPECT_EQ(counters["deadline.missed_detect"], 0);
  EXPECT_EQ(counters["slam.frames"], 0) << "of the last record";
  EXPECT_EQ(counters["published.poses"], 3);
  EXPECT_EQ(counters["dropped.unsent"], 0);
  EXPECT_EQ(counters["dropped.queue"], 0);
}

TEST_F(PublisherTest, AMessageThatIsTooLargeIsNotSentButCounted) {
  camera_.report(CameraState::kRunning, "");
  // Detections name their dictionary.
  const std::string endless(70'000, 'x');
  publisher_ = std::make_unique<Publisher>(options_, BodyMotion::Options{}, endless, output_,
                                           camera_, frames_, health_, log_);
  give(localized(1));
  output_.finished = true;
  start();
  const Received all = allOfIt();
  ASSERT_EQ(all.poses.size(), 1U);
  EXPECT_TRUE(all.detections.empty());
  std::map<std::string, std::int64_t> counters = all.counters();
  EXPECT_EQ(counters["published.poses"], 1);
  EXPECT_EQ(counters["dropped.unsent"], 0) << "the frame's pose is out";
  EXPECT_GE(counters["unsent.too_large"], 1);
  EXPECT_EQ(counters["unsent.link_down"], 0);
}

TEST_F(PublisherTest, TheTapGetsTheSameBytesAsTheNetwork) {
  camera_.report(CameraState::kRunning, "");
  std::map<std::string, int> messages;
  pose_t tapped{};
  publisher_->setTap(
      [&](std::string_view channel, std::span<const std::uint8_t> bytes, std::int64_t utime) {
        ++messages[std::string(channel)];
        EXPECT_NEAR(static_cast<double>(utime), static_cast<double>(wallUs()), 60e6);
        if (channel == "TEST_POSE") {
          EXPECT_GT(tapped.decode(bytes.data(), 0, static_cast<int>(bytes.size())), 0);
        }
      });
  give(localized(6));
  giveMap(1);
  output_.finished = true;
  start();
  const Received all = allOfIt();
  EXPECT_EQ(tapped.sequence, 6);
  EXPECT_EQ(tapped.latency_ns, all.poses[0].latency_ns);
  EXPECT_EQ(messages["TEST_POSE"], 1);
  EXPECT_EQ(messages["POSE"], 1);
  EXPECT_EQ(messages["TEST_DETECTIONS"], 1);
  EXPECT_EQ(messages["TEST_MAP"], 1);
  EXPECT_EQ(messages["TEST_HEALTH"], static_cast<int>(all.healths.size()));
}

}  // namespace
}  // namespace waymark::daemon
