#include "capture/frame_maker.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace waymark::capture {
namespace {

constexpr int kWidth = 8;
constexpr int kHeight = 4;
constexpr int kBuffers = 3;

TEST(FrameMaker, AGreyPlaneIsShownWhereItLies) {
  constexpr std::ptrdiff_t kStride = 10;
  FrameMaker maker({PixelLayout::kGrey8, kWidth, kHeight, kStride}, kBuffers);
  SourceCounters counters;
  const std::vector<std::uint8_t> data(kStride * kHeight + 16, 9);  // colours follow
  FramePtr frame = maker.make(1, data, 77, &counters);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->image().data, data.data());
  EXPECT_EQ(frame->image().stride, kStride);
  EXPECT_EQ(frame->dmaBuf(), 77);
  EXPECT_TRUE(maker.shows(1));
  EXPECT_FALSE(maker.shows(0));
  frame.reset();
  EXPECT_FALSE(maker.shows(1));
}

TEST(FrameMaker, TheLastRowNeedNoGap) {
  constexpr std::ptrdiff_t kStride = 10;
  FrameMaker maker({PixelLayout::kGrey8, kWidth, kHeight, kStride}, kBuffers);
  SourceCounters counters;
  const std::vector<std::uint8_t> data(kStride * (kHeight - 1) + kWidth);
  EXPECT_TRUE(maker.make(0, data, -1, &counters));
  EXPECT_FALSE(maker.make(1, std::span(data).first(data.size() - 1), -1, &counters));
  EXPECT_EQ(counters.dropped_corrupt, 1u);
}

TEST(FrameMaker, AllElseIsConverted) {
  FrameMaker maker({PixelLayout::kGreyEven, kWidth, kHeight, 2 * kWidth}, kBuffers);
  SourceCounters counters;
  const std::vector<std::uint8_t> data(2 * kWidth * kHeight, 50);
  std::vector<FramePtr> held;
  for (int i = 0; i < kBuffers; ++i) {
    held.push_back(maker.make(0, data, 77, &counters));
    ASSERT_TRUE(held.back());
    EXPECT_EQ(held.back()->image().at(kWidth - 1, kHeight - 1), 50);
    EXPECT_EQ(held.back()->dmaBuf(), -1) << "the copy has none";
    EXPECT_FALSE(maker.shows(0)) << "the camera may have its buffer back";
  }
  EXPECT_FALSE(maker.make(0, data, 77, &counters));
  EXPECT_EQ(counters.dropped_no_buffer, 1u);
}

TEST(FrameMaker, TheCamerasJpegIsKeptWhereWanted) {
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(90)), jpeg);
  SourceCounters counters;
  for (const bool keep : {false, true}) {
    FrameMaker maker({PixelLayout::kJpeg, kWidth, kHeight, 0, keep}, kBuffers);
    const FramePtr frame = maker.make(0, jpeg, -1, &counters);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->image().at(3, 3), 90);
    EXPECT_EQ(std::ranges::equal(frame->jpeg(), jpeg), keep);
  }
}

TEST(FrameMaker, TornPicturesAreCounted) {
  FrameMaker maker({PixelLayout::kJpeg, kWidth, kHeight, 0}, kBuffers);
  SourceCounters counters;
  const std::vector<std::uint8_t> data = {0xff, 0xd8, 0x00, 0x00};
  EXPECT_FALSE(maker.make(0, data, -1, &counters));
  EXPECT_FALSE(maker.make(0, {}, -1, &counters));
  EXPECT_EQ(counters.dropped_corrupt, 2u);
}

}  // namespace
}  // namespace waymark::capture
