#include "daemon/preview/preview_maker.h"

#include <memory>
#include <random>

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace waymark::daemon {
namespace {

// A light wall with two dark squares, of which the left one was found as a marker.
class PreviewMakerTest : public ::testing::Test {
 protected:
  void draw(int width, int height) {
    image_ = cv::Mat(height, width, CV_8UC1, cv::Scalar(200));
    const int side = width / 8;
    left_ = {width / 8, height / 4, side, side};
    right_ = {5 * width / 8, height / 4, side, side};
    cv::rectangle(image_, left_, cv::Scalar(20), cv::FILLED);
    cv::rectangle(image_, right_, cv::Scalar(20), cv::FILLED);
    frame_->stamp = {.sequence = 9, .monotonic_ns = 8, .utime = 7};
    frame_->image = {image_.data, width, height, static_cast<std::ptrdiff_t>(image_.step)};
    frame_->seen = 1;
    const double x = left_.x, y = left_.y, s = side - 1;
    frame_->markers[0] = {Eigen::Vector2d(x, y), Eigen::Vector2d(x + s, y),
                          Eigen::Vector2d(x + s, y + s), Eigen::Vector2d(x, y + s)};
  }

  cv::Mat image_;
  cv::Rect left_, right_;
  std::unique_ptr<PreviewLink::Query> frame_ = std::make_unique<PreviewLink::Query>();
  PreviewMaker maker_;
  preview_t message_{};
};

TEST_F(PreviewMakerTest, SaysWhichFrameItIsAndHasItsImage) {
  draw(640, 480);
  ASSERT_TRUE(maker_.make(*frame_, &message_));
  EXPECT_EQ(message_.sequence, 9);
  EXPECT_EQ(message_.monotonic_ns, 8);
  EXPECT_EQ(message_.utime, 7);
  const cv::Mat shown = cv::imdecode(message_.jpeg, cv::IMREAD_GRAYSCALE);
  ASSERT_EQ(shown.size(), image_.size());
  EXPECT_LT(cv::norm(shown, image_, cv::NORM_L1) / static_cast<double>(shown.total()), 3.0);
}

TEST_F(PreviewMakerTest, TellsTheSquareThatIsNoMarkerInPixelsOfTheFrame) {
  for (const int width : {640, 1920}) {
    draw(width, width * 3 / 4);
    ASSERT_TRUE(maker_.make(*frame_, &message_));
    EXPECT_EQ(message_.width, width);
    EXPECT_LE(cv::imdecode(message_.jpeg, cv::IMREAD_GRAYSCALE).cols, 640);
    ASSERT_EQ(message_.rejected_count, 1) << "the other one is a marker";
    Eigen::Vector2d least(1e9, 1e9);
    Eigen::Vector2d most(-1e9, -1e9);
    for (const auto& corner : message_.rejected_px[0]) {
      least = least.cwiseMin(Eigen::Vector2d(corner[0], corner[1]));
      most = most.cwiseMax(Eigen::Vector2d(corner[0], corner[1]));
    }
    const double tolerance = 2.0 * width / 640.0;
    EXPECT_NEAR(least.x(), right_.x, tolerance);
    EXPECT_NEAR(least.y(), right_.y, tolerance);
    EXPECT_NEAR(most.x(), right_.x + right_.width - 1, tolerance);
    EXPECT_NEAR(most.y(), right_.y + right_.height - 1, tolerance);
  }
}

TEST_F(PreviewMakerTest, NoMessageIsLargerThanWhatLcmCarries) {
  draw(640, 480);
  std::mt19937 random(1);
  for (int i = 0; i < 640 * 480; ++i) image_.data[i] = static_cast<std::uint8_t>(random());
  if (maker_.make(*frame_, &message_)) {
    EXPECT_LE(message_.getEncodedSize(), 60'000);
  }
  draw(640, 480);
  ASSERT_TRUE(maker_.make(*frame_, &message_)) << "the next one is not spoilt";
  EXPECT_LE(message_.getEncodedSize(), 60'000);
}

}  // namespace
}  // namespace waymark::daemon
