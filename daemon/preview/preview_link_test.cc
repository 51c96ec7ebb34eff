#include "daemon/preview/preview_link.h"

#include <cstdint>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

constexpr int kWidth = 64;
constexpr int kHeight = 48;
constexpr std::ptrdiff_t kStride = kWidth + 3;  // rows are farther apart than they are long
constexpr std::int64_t kSecond = 1'000'000'000;

struct Image {
  explicit Image(std::uint8_t value) : pixels(static_cast<std::size_t>(kStride * kHeight), value) {}
  [[nodiscard]] ImageView view() const { return {pixels.data(), kWidth, kHeight, kStride}; }
  std::vector<std::uint8_t> pixels;
};

TEST(PreviewLink, WantsNothingUntilSomebodyAsksAndNotForLongerThanThat) {
  PreviewLink link(kWidth, kHeight);
  EXPECT_FALSE(link.wanted(kSecond));
  link.ask(kSecond);
  EXPECT_TRUE(link.wanted(kSecond));
  EXPECT_TRUE(link.wanted(kSecond + PreviewLink::kLease_ns - 1));
  EXPECT_FALSE(link.wanted(kSecond + PreviewLink::kLease_ns));
}

TEST(PreviewLink, ACopyOfAFrameGoesOverAndNoOtherUntilItIsDoneWith) {
  PreviewLink link(kWidth, kHeight);
  link.ask(0);
  std::vector<slam::MarkerDetection> markers(2);
  markers[1].pixels[2] = {7.5, 8.5};
  {
    const Image image(17);
    link.give({.sequence = 5}, image.view(), markers, 1);
  }
  EXPECT_FALSE(link.wanted(kSecond)) << "the other thread has it";
  const PreviewLink::Query* const frame = link.wait();
  ASSERT_NE(frame, nullptr);
  EXPECT_EQ(frame->stamp.sequence, 5U);
  ASSERT_EQ(frame->seen, 2U);
  EXPECT_EQ(frame->markers[1][2], Eigen::Vector2d(7.5, 8.5));
  EXPECT_EQ(frame->image.at(kWidth - 1, kHeight - 1), 17);
  link.done();
  EXPECT_FALSE(link.wanted(PreviewLink::kInterval_ns)) << "a few a second";
  EXPECT_TRUE(link.wanted(PreviewLink::kInterval_ns + 1));
}

TEST(PreviewLink, AnImageOfAnotherSizeIsLeftOut) {
  PreviewLink link(kWidth + 1, kHeight);
  link.ask(0);
  link.give({}, Image(1).view(), {}, 1);
  EXPECT_TRUE(link.wanted(1));
}

TEST(PreviewLink, AStopEndsTheWait) {
  PreviewLink link(kWidth, kHeight);
  std::thread other([&] { EXPECT_EQ(link.wait(), nullptr); });
  link.requestStop();
  other.join();
}

// For the thread sanitizer, and against torn images: both sides as fast as they can, while a third
// asks.
TEST(PreviewLink, ImagesComeOverWhole) {
  constexpr int kFrames = 2000;
  PreviewLink link(kWidth, kHeight);
  int received = 0;
  std::thread other([&] {
    while (const PreviewLink::Query* const frame = link.wait()) {
      const auto expected = static_cast<std::uint8_t>(frame->stamp.sequence);
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) ASSERT_EQ(frame->image.at(x, y), expected);
      }
      ++received;
      link.done();
    }
  });
  std::int64_t now_ns = 0;
  int given = 0;
  for (std::uint64_t i = 0; given < kFrames; ++i) {
    now_ns += PreviewLink::kInterval_ns;
    if (i % 10 == 0) {
      std::thread asker([&link, now_ns] { link.ask(now_ns); });
      asker.join();
    }
    if (!link.wanted(now_ns)) {
      std::this_thread::yield();
      continue;
    }
    link.give({.sequence = i}, Image(static_cast<std::uint8_t>(i)).view(), {}, now_ns);
    ++given;
  }
  while (!link.wanted(now_ns + PreviewLink::kInterval_ns)) std::this_thread::yield();
  link.requestStop();
  other.join();
  EXPECT_EQ(received, kFrames);
}

}  // namespace
}  // namespace waymark::daemon
