// Natural markers in photographs in no order, as `waymark run --natural` has them: each has its
// pose from what is in it, and nothing is carried from one to the next.
#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/final_map.h"
#include "slam/final_trajectory.h"
#include "slam/slam.h"
#include "tests/poster_wall.h"
#include "tools/natural/photograph_relocalizer.h"

namespace waymark {
namespace {

using slam::PoseSource;
using slam::TrackingState;
using slam::Transform;
using testing::facingWall;
using testing::kMarker;
using testing::nameOf;

class NaturalPhotographsTest : public ::testing::Test {
 protected:
  void start(int posters, int surveyed) {
    wall_.emplace(posters);
    slam::Options options;
    options.markers.size_m = testing::kMarkerSize_m;
    options.treatAsUnorderedImages();
    options.natural.prints = wall_->prints(surveyed);
    ASSERT_EQ(options.invalidReason(), "");
    slam_.emplace(slam::CameraModel(testing::lens()), *slam::Dictionary::byName("APRILTAG_36h11"),
                  options);
    relocalizer_.emplace(wall_->pictures());
  }

  // From x, a metre in front of the wall.
  slam::FrameResult take(double x_m, bool with_marker) {
    truths_.push_back(facingWall(x_m, 1.0, 0.0));
    const std::size_t i = frames_.size();
    const auto& pixels = wall_->render(truths_.back(), with_marker, i);
    const slam::FrameInput input =
        relocalizer_->prepare({.time = {i, static_cast<std::int64_t>(i) * 33'333'333},
                               .image = ImageView{pixels.data(), 640, 480, 640}},
                              *slam_);
    slam::FrameResult result = slam_->process(input);
    frames_.push_back({input.time.monotonic_ns,
                       result.pose,
                       {result.detections.begin(), result.detections.end()},
                       {result.found.begin(), result.found.end()}});
    result.detections = {};  // they end here
    result.found = {};
    return result;
  }

  std::optional<testing::PosterWall> wall_;
  std::optional<slam::Slam> slam_;
  std::optional<tools::PhotographRelocalizer> relocalizer_;
  std::vector<Transform> truths_;
  std::vector<slam::LiveFrame> frames_;
};

TEST_F(NaturalPhotographsTest, SurveyedPostersAloneGiveEachItsPose) {
  start(3, 3);
  int number = 0;
  for (const double x_m : {2.75, 0.35, 1.55, -0.35, 2.05}) {
    const slam::FrameResult result = take(x_m, false);
    ASSERT_TRUE(result.pose) << x_m;
    EXPECT_EQ(result.state, TrackingState::kBridging);
    EXPECT_EQ(result.reason, slam::NoPoseReason::kNone);
    EXPECT_EQ(result.pose->source, PoseSource::kNaturalFeatures);
    const slam::Vector6d e = result.pose->T_w_c.localCoordinates(truths_.back());
    EXPECT_LT(e.head<3>().norm(), 0.01) << x_m;
    EXPECT_LT(e.dot(result.pose->covariance.ldlt().solve(e)), 22.5) << x_m;
    ++number;
  }
  EXPECT_EQ(slam_->counters().photographs_by_picture, static_cast<std::uint64_t>(number));
  EXPECT_EQ(slam_->counters().late_unknown, 0U);
}

// A photograph that was taken too early is placed in the end.
TEST_F(NaturalPhotographsTest, APosterBesideAMarkerPlacesThoseWithoutTheMarker) {
  start(1, 0);
  EXPECT_EQ(take(0.95, true).state, TrackingState::kTracking) << "the marker begins the map";
  EXPECT_FALSE(take(-0.35, false).pose) << "nobody knows yet where the poster is";
  for (const double x_m : {0.22, 0.30, 0.26, 0.36, 0.32, 0.24}) (void)take(x_m, true);
  const slam::MapMarker* const marker = slam_->map().findPosed(kMarker);
  ASSERT_NE(marker, nullptr);
  ASSERT_NE(slam_->map().findPosed(slam::pictureId(nameOf(0))), nullptr);
  const auto errorOf = [&](const slam::PoseEstimate& pose, const Transform& truth) {
    const Transform T_true_w = wall_->marker() * slam_->map().findPosed(kMarker)->T_w_m->inverse();
    return ((T_true_w * pose.T_w_c).p - truth.p).norm();
  };
  const slam::FrameResult late = take(-0.30, false);
  ASSERT_TRUE(late.pose);
  EXPECT_EQ(late.pose->source, PoseSource::kNaturalFeatures);
  EXPECT_LT(errorOf(*late.pose, truths_.back()), 0.03);

  slam::makeFinalMap(frames_, {.unordered_images = true}, &*slam_);
  const auto all = slam::localizeAll(frames_, {.unordered_images = true}, *slam_);
  ASSERT_EQ(all.size(), frames_.size());
  for (const std::size_t i : {std::size_t{1}, frames_.size() - 1}) {
    ASSERT_TRUE(all[i].pose) << i;
    EXPECT_LT(errorOf(*all[i].pose, truths_[i]), 0.03) << i;
  }
}

}  // namespace
}  // namespace waymark
