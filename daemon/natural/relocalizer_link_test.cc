#include "daemon/natural/relocalizer_link.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "slam/map/picture_print.h"
#include "slam/testing/synthetic.h"

namespace waymark::daemon {
namespace {

constexpr int kWidth = 8;
constexpr int kHeight = 4;
const int kPoster = slam::pictureId("poster");
const int kSign = slam::pictureId("sign");

class RelocalizerLinkTest : public ::testing::Test {
 protected:
  RelocalizerLinkTest() {
    slam::PicturePrint sign;
    sign.name = "sign";
    sign.width_m = 0.3;
    sign.height_m = 0.2;
    map_.addPicture(sign);
    for (std::size_t i = 0; i < pixels_.size(); ++i) pixels_[i] = static_cast<std::uint8_t>(i);
  }

  // With rows that are farther apart than they are long.
  slam::FrameInput frame(std::uint64_t sequence) {
    return {.time = {sequence, static_cast<std::int64_t>(1000 * sequence)},
            .image = ImageView{pixels_.data(), kWidth, kHeight, kStride}};
  }
  static slam::LateResult found(const RelocalizerLink::Query& query, int landmark) {
    return {.sequence = query.frame.time.sequence,
            .generation = query.frame.generation,
            .landmark = landmark,
            .T_m_c = slam::Transform{}.retract(
                (slam::Vector6d() << 0.1, 0.2, 0.9, 0.3, -2.0, 0.7).finished()),
            .covariance = slam::Matrix6d::Identity()};
  }
  // One round of the other thread.
  void answer(int landmark) {
    const RelocalizerLink::Query* const query = link_.wait();
    ASSERT_NE(query, nullptr);
    const slam::LateResult result = found(*query, landmark);
    link_.answer({&result, 1});
  }

  static constexpr std::ptrdiff_t kStride = kWidth + 3;
  std::vector<std::uint8_t> pixels_ = std::vector<std::uint8_t>(kStride * kHeight);
  slam::Map map_;
  slam::CameraModel camera_{slam::testing::testCalibration()};
  slam::FrameResult result_;
  RelocalizerLink link_{{kPoster, kSign}, kWidth, kHeight};
};

TEST_F(RelocalizerLinkTest, WhatIsAskedComesAsACopy) {
  slam::PoseEstimate pose;
  pose.T_w_c.p = {1.0, 2.0, 3.0};
  pose.covariance = 0.5 * slam::Matrix6d::Identity();
  result_.pose = pose;
  ASSERT_TRUE(link_.idle());
  link_.ask(frame(7), result_, camera_, map_, 1);
  EXPECT_FALSE(link_.idle());
  pixels_[0] = 99;
  const RelocalizerLink::Query* const query = link_.wait();
  ASSERT_NE(query, nullptr);
  EXPECT_EQ(query->frame.time.sequence, 7U);
  EXPECT_EQ(query->frame.time.monotonic_ns, 7000);
  const ImageView& image = query->frame.image;
  ASSERT_EQ(image.width, kWidth);
  ASSERT_EQ(image.height, kHeight);
  EXPECT_EQ(image.at(0, 0), 0) << "as it was when asked";
  EXPECT_EQ(image.at(7, 3), static_cast<std::uint8_t>(3 * kStride + 7));
  ASSERT_TRUE(query->camera);
  EXPECT_EQ(query->camera->calibration(), camera_.calibration()) << "the lens in use";
  ASSERT_TRUE(query->frame.last);
  EXPECT_EQ(query->frame.last->T_w_c.p, pose.T_w_c.p);
  EXPECT_EQ(query->frame.last->position_covariance(1, 1), 0.5);
}

TEST_F(RelocalizerLinkTest, AnAnswerIsHeardOnce) {
  link_.ask(frame(7), result_, camera_, map_, 1);
  EXPECT_TRUE(link_.hear().empty()) << "not yet";
  answer(kSign);
  const auto late = link_.hear();
  ASSERT_EQ(late.size(), 1U);
  EXPECT_EQ(late[0].sequence, 7U);
  EXPECT_EQ(late[0].landmark, kSign);
  EXPECT_TRUE(link_.hear().empty());
}

TEST_F(RelocalizerLinkTest, AskedAgainOnlyWhenItHasRested) {
  link_.ask(frame(7), result_, camera_, map_, 1);
  answer(kSign);
  EXPECT_FALSE(link_.idle()) << "not heard yet";
  (void)link_.hear();
  EXPECT_FALSE(link_.idle()) << "it rests";
  link_.rest(std::chrono::microseconds(1));
  std::thread other([&] { (void)link_.wait(); });
  while (!link_.idle()) std::this_thread::yield();
  link_.ask(frame(9), result_, camera_, map_, 1);
  other.join();
}

// Poses of pictures are looked up when the map is another one.
TEST_F(RelocalizerLinkTest, FollowsTheMap) {
  const auto poses = [&](std::uint64_t sequence, std::uint64_t revision) {
    (void)link_.hear();
    link_.ask(frame(sequence), result_, camera_, map_, revision);
    const std::vector<std::optional<slam::Transform>> told = link_.wait()->T_w_m;
    link_.answer({});
    return told;
  };
  ASSERT_EQ(poses(1, 1).size(), 2U);
  EXPECT_FALSE(poses(1, 1)[1]) << "it has no place yet";
  map_.place(kSign, {.R = Eigen::Matrix3d::Identity(), .p = {4.0, 5.0, 6.0}}, {},
             slam::Matrix6d::Identity());
  EXPECT_FALSE(poses(2, 1)[1]) << "the map is said to be the same";
  const auto told = poses(3, 2);
  EXPECT_FALSE(told[0]) << "the map does not know it";
  ASSERT_TRUE(told[1]);
  EXPECT_EQ(told[1]->p, Eigen::Vector3d(4.0, 5.0, 6.0));
}

TEST_F(RelocalizerLinkTest, AnotherSlamHearsNothingOfTheOneBefore) {
  link_.ask(frame(7), result_, camera_, map_, 1);
  link_.forget();
  answer(kSign);
  EXPECT_TRUE(link_.hear().empty());
}

TEST_F(RelocalizerLinkTest, TooManyAreLeftOutAndCounted) {
  link_.ask(frame(7), result_, camera_, map_, 1);
  const RelocalizerLink::Query* const query = link_.wait();
  ASSERT_NE(query, nullptr);
  const std::vector<slam::LateResult> many(RelocalizerLink::kMostResults + 3, found(*query, kSign));
  link_.answer(many);
  EXPECT_EQ(link_.hear().size(), RelocalizerLink::kMostResults);
  EXPECT_EQ(link_.leftOut(), 3U);
}

TEST_F(RelocalizerLinkTest, AStopEndsTheWaitAndTheRest) {
  std::thread waiting([&] { EXPECT_EQ(link_.wait(), nullptr); });
  link_.requestStop();
  waiting.join();
  RelocalizerLink resting({kSign}, kWidth, kHeight);
  std::thread other([&] {
    resting.rest(std::chrono::hours(1));
    EXPECT_EQ(resting.wait(), nullptr);
  });
  resting.requestStop();
  other.join();
}

// Both threads as fast as they can: each answer is of the frame asked about last, whose picture it
// has seen whole.
TEST_F(RelocalizerLinkTest, TwoThreadsHandFramesToAndFro) {
  std::thread other([&] {
    while (const RelocalizerLink::Query* const query = link_.wait()) {
      const auto value = static_cast<std::uint8_t>(query->frame.time.sequence);
      int different = 0;
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) different += query->frame.image.at(x, y) == value ? 0 : 1;
      }
      const slam::LateResult result = found(*query, different);
      link_.answer({&result, 1});
      link_.rest(std::chrono::nanoseconds(0));
    }
  });
  std::uint64_t asked = 0;
  int heard = 0;
  for (std::uint64_t sequence = 1; heard < 500; ++sequence) {
    for (const slam::LateResult& late : link_.hear()) {
      EXPECT_EQ(late.sequence, asked);
      EXPECT_EQ(late.landmark, 0) << "pixels of another frame";
      ++heard;
    }
    std::ranges::fill(pixels_, static_cast<std::uint8_t>(sequence));
    if (!link_.idle()) continue;
    link_.ask(frame(sequence), result_, camera_, map_, sequence);
    asked = sequence;
  }
  link_.requestStop();
  other.join();
}

}  // namespace
}  // namespace waymark::daemon
