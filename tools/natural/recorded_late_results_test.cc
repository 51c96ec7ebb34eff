#include "tools/natural/recorded_late_results.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include <waymark/natural_detections_t.hpp>

namespace waymark::tools {
namespace {

natural_detections_t someMessage() {
  natural_detections_t message{};
  message.sequence = 31;
  message.searched = 1;
  message.count = 2;
  message.detections.resize(2);
  for (std::size_t i = 0; i < 2; ++i) {
    natural_detection_t& detection = message.detections[i];
    detection.sequence = 26;
    detection.id = 1'500'000'000 + static_cast<int>(i);
    detection.name = i == 0 ? "" : "exit sign";
    detection.p_m_c[2] = 0.7;
    detection.q_m_c[1] = 1.0;
    detection.covariance[8] = 0.25;
    detection.decided = i == 0 ? 1 : 0;
    detection.ambiguity_ratio = 1.5;
    detection.has_other = i == 0 ? 0 : 1;
    detection.other_p_m_c[0] = 0.125;
    detection.other_q_m_c[2] = 1.0;
    detection.other_covariance[8] = 0.5;
  }
  return message;
}

std::vector<std::uint8_t> encoded(const natural_detections_t& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

TEST(RecordedLateResults, AMessageIsReadBack) {
  const auto decoded = decodeNaturalDetections(encoded(someMessage()));
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->sequence, 31U);
  EXPECT_TRUE(decoded->recorded.searched);
  ASSERT_EQ(decoded->recorded.late.size(), 2U);
  const slam::LateResult& late = decoded->recorded.late[1];
  EXPECT_EQ(late.sequence, 26U);
  EXPECT_EQ(late.landmark, 1'500'000'001);
  EXPECT_EQ(late.T_m_c.p.z(), 0.7);
  EXPECT_EQ(late.T_m_c.R(1, 1), -1.0);
  EXPECT_EQ(late.covariance(1, 2), 0.25);
  EXPECT_FALSE(late.decided);
  EXPECT_EQ(late.ambiguity_ratio, 1.5);
  ASSERT_TRUE(late.other);
  EXPECT_EQ(late.other->T_m_c.p.x(), 0.125);
  EXPECT_EQ(late.other->T_m_c.R(0, 0), -1.0);
  EXPECT_EQ(late.other->covariance(1, 2), 0.5);
  EXPECT_TRUE(decoded->recorded.late[0].decided);
  EXPECT_FALSE(decoded->recorded.late[0].other);
}

TEST(RecordedLateResults, WhatIsNoSuchMessageIsNone) {
  const std::vector<std::uint8_t> whole = encoded(someMessage());
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_FALSE(decodeNaturalDetections(std::span(whole).first(size))) << size;
  }
  std::vector<std::uint8_t> longer = whole;
  longer.push_back(0);
  EXPECT_FALSE(decodeNaturalDetections(longer));
  natural_detections_t absurd = someMessage();
  absurd.detections[0].p_m_c[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(decodeNaturalDetections(encoded(absurd)));
  absurd = someMessage();
  absurd.detections[1].other_covariance[3] = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(decodeNaturalDetections(encoded(absurd)));
}

TEST(RecordedLateResults, AreGivenWithTheirFrame) {
  auto decoded = decodeNaturalDetections(encoded(someMessage()));
  ASSERT_TRUE(decoded);
  RecordedLateResults results({{decoded->sequence, decoded->recorded}});
  slam::Options options;
  options.markers.size_m = 0.1;
  const slam::CameraModel camera(
      {.width = 640, .height = 480, .fx = 512.0, .fy = 512.0, .cx = 319.5, .cy = 239.5});
  const slam::Slam slam(camera, *slam::Dictionary::byName("4X4_50"), options);
  const slam::FrameInput other = results.prepare({.time = {30, 0}}, slam);
  EXPECT_FALSE(other.awaited);
  EXPECT_TRUE(other.late.empty());
  const slam::FrameInput frame = results.prepare({.time = {31, 0}}, slam);
  EXPECT_TRUE(frame.awaited);
  EXPECT_EQ(frame.late.size(), 2U);
}

}  // namespace
}  // namespace waymark::tools
