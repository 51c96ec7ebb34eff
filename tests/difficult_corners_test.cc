// Corners that are hard to see: large markers out of focus, paper that is bent or has hardly a
// margin. They are found, and their covariance tells how good they are; poses from them, too.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "simulator/testing/marker_photo.h"
#include "slam/detection/marker_detector.h"
#include "slam/detection/search/marker_follower.h"
#include "slam/geometry/align_points.h"
#include "slam/geometry/transform.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark {
namespace {

using simulator::testing::MarkerPhoto;
using simulator::testing::MarkerPhotoOptions;
using slam::MarkerDetection;
using slam::Transform;
using Corners = std::array<Eigen::Vector2d, 4>;

const slam::Dictionary& dictionary() {
  static const slam::Dictionary instance = *slam::Dictionary::byName("APRILTAG_36h11");
  return instance;
}

std::optional<MarkerDetection> detect(const MarkerPhoto& photo, int id) {
  slam::MarkerDetector detector(photo.camera(), dictionary());
  for (const MarkerDetection& seen : detector.detect(photo.image())) {
    EXPECT_EQ(seen.id, id) << "a false id";
    if (seen.id == id) return seen;
  }
  return std::nullopt;
}

// Of many corners: 1 is an exact covariance, less a cautious one.
struct Consistency {
  double chi2 = 0.0;
  double squared_px2 = 0.0;
  double inwards_px = 0.0;  // towards the marker's middle
  int coordinates = 0;

  // truth: normalized.
  void add(const MarkerDetection& seen, const Corners& truth, double focal_px) {
    const Eigen::Vector2d middle = 0.25 * (truth[0] + truth[1] + truth[2] + truth[3]);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector2d error = seen.normalized[k] - truth[k];
      inwards_px += focal_px * error.dot((middle - truth[k]).normalized());
      chi2 += error.dot(seen.covariance[k].inverse() * error);
      squared_px2 += focal_px * focal_px * error.squaredNorm();
      coordinates += 2;
    }
  }
  [[nodiscard]] double mean() const { return chi2 / coordinates; }
  [[nodiscard]] double rms_px() const { return std::sqrt(squared_px2 / coordinates); }
  [[nodiscard]] double meanInwards_px() const { return inwards_px / (0.5 * coordinates); }
};

Corners normalizedOf(const std::array<Eigen::Vector3d, 4>& points) {
  Corners corners;
  for (std::size_t k = 0; k < 4; ++k) corners[k] = points[k].head<2>() / points[k].z();
  return corners;
}

struct Views {
  int photos = 0;
  int found = 0;
  Consistency corners;

  void add(const MarkerPhotoOptions& options) {
    ++photos;
    const MarkerPhoto photo(dictionary(), options);
    const auto seen = detect(photo, options.id);
    if (!seen) return;
    ++found;
    corners.add(*seen, normalizedOf(photo.corners_c()), photo.camera().focalLength());
  }
};

// `each`: what all photographs have in common.
Views look(MarkerPhotoOptions each, const std::vector<double>& tilts_deg) {
  Views views;
  for (const double tilt_deg : tilts_deg) {
    for (int i = 0; i < 2; ++i) {
      const int number = views.photos + 1;
      each.id = 7 * number;
      each.tilt_deg = tilt_deg;
      each.wall = i == 0 ? 120.0 : 190.0;
      each.seed = static_cast<std::uint64_t>(number);
      views.add(each);
    }
  }
  return views;
}

// --- Blur --------------------------------------------------------------------------------------

struct Blurred {
  double side_px;
  double blur_px;
};

class LargeBlurredMarkers : public ::testing::TestWithParam<Blurred> {};

TEST_P(LargeBlurredMarkers, AreFoundAndTheirCovarianceIsHonest) {
  const auto [side_px, blur_px] = GetParam();
  for (const double noise_sigma : {2.0, 5.0}) {
    const Views views =
        look({.side_px = side_px, .blur_px = blur_px, .noise_sigma = noise_sigma}, {0.0, 40.0});
    EXPECT_EQ(views.found, views.photos) << noise_sigma;
    ASSERT_GT(views.found, 0);
    EXPECT_LT(views.corners.rms_px(), 0.1 * blur_px) << noise_sigma;
    EXPECT_LT(views.corners.mean(), 2.0) << noise_sigma;
    EXPECT_GT(views.corners.mean(), 0.02) << noise_sigma;
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, LargeBlurredMarkers,
                         ::testing::Values(Blurred{100, 3}, Blurred{150, 4}, Blurred{200, 6},
                                           Blurred{280, 4}, Blurred{280, 8}, Blurred{400, 6}),
                         [](const auto& param_info) {
                           return "Side" +
                                  std::to_string(static_cast<int>(param_info.param.side_px)) +
                                  "Blur" +
                                  std::to_string(static_cast<int>(param_info.param.blur_px));
                         });

// Small blur: as it was, to a few hundredths of a pixel.
TEST(SharpMarkers, AreMeasuredAtFullSize) {
  const Views views = look({.side_px = 120.0, .blur_px = 0.6}, {0.0, 30.0, 60.0});
  EXPECT_EQ(views.found, views.photos);
  EXPECT_LT(views.corners.rms_px(), 0.03);
  const MarkerPhoto photo(dictionary(), {.id = 3, .side_px = 120.0, .blur_px = 0.6});
  slam::MarkerDetector detector(photo.camera(), dictionary());
  ASSERT_EQ(detector.detect(photo.image()).size(), 1U);
  EXPECT_EQ(detector.measured().front().factor, 1);
}

// An autofocus that loses a marker in view, and finds it again.
TEST(BlurThatComesAndGoes, LosesNoFrame) {
  std::optional<slam::MarkerFollower> follower;
  std::vector<MarkerPhoto> photos;
  for (const double blur_px : {0.6, 1.5, 3.0, 4.5, 6.0, 6.0, 4.5, 3.0, 1.5, 0.6}) {
    // One place, and images of one size.
    photos.emplace_back(dictionary(), MarkerPhotoOptions{.id = 5,
                                                         .side_px = 240.0,
                                                         .tilt_deg = 20.0,
                                                         .blur_px = blur_px,
                                                         .image_px = 480,
                                                         .seed = 3});
  }
  follower.emplace(photos.front().camera(), dictionary(), slam::DetectorOptions{},
                   slam::FollowerOptions{});
  std::int64_t time_ns = 0;
  for (const MarkerPhoto& photo : photos) {
    const auto& found = follower->find(photo.image(), time_ns += 33'000'000, {});
    ASSERT_EQ(found.size(), 1U) << time_ns / 33'000'000;
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_LT((found[0].pixels[k] - photo.corners()[k]).norm(), 1.0);
    }
  }
  EXPECT_EQ(follower->followed().front().measured.factor, 1) << "sharp again";
}

// --- Paper -------------------------------------------------------------------------------------

// The pose of a square that fits the print's corners best.
Transform squareOf(const MarkerPhoto& photo) {
  const auto flat = slam::markerCorners(MarkerPhoto::kSize_m);
  const auto bent = photo.corners_c();
  return slam::alignPoints(flat, bent);
}

// Normalized error of the pose that a marker's corners give: mean 1 where their covariance is
// exact. Of two poses the one that is meant.
double poseError(const MarkerDetection& seen, const Transform& truth, double focal_px) {
  const auto pose = slam::estimateSquarePose(seen, MarkerPhoto::kSize_m, focal_px);
  if (!pose) return 1e9;
  const auto farther = [&](const Transform& a, const Transform& b) {
    return slam::rotationDistance(a.R, truth.R) > slam::rotationDistance(b.R, truth.R);
  };
  const Transform& T = farther(pose->T_c_m[0], pose->T_c_m[1]) ? pose->T_c_m[1] : pose->T_c_m[0];
  slam::Matrix6d information = slam::Matrix6d::Zero();
  const auto corners = slam::markerCorners(MarkerPhoto::kSize_m);
  for (std::size_t k = 0; k < 4; ++k) {
    Eigen::Matrix<double, 2, 6> J;
    for (Eigen::Index i = 0; i < 6; ++i) {
      constexpr double kStep = 1e-6;
      const auto at = [&](double step) -> Eigen::Vector2d {
        const Eigen::Vector3d p = T.retract(step * slam::Vector6d::Unit(i)) * corners[k];
        return p.head<2>() / p.z();
      };
      J.col(i) = (at(kStep) - at(-kStep)) / (2.0 * kStep);
    }
    information += J.transpose() * seen.covariance[k].inverse() * J;
  }
  const slam::Vector6d error = T.localCoordinates(truth);
  return error.dot(information * error) / 6.0;
}

struct Bent {
  double radius;  // sides of the marker
  double side_px;
};

class BentPaper : public ::testing::TestWithParam<Bent> {};

TEST_P(BentPaper, ShowsInTheCovarianceNotInTheCorners) {
  const auto [radius, side_px] = GetParam();
  Consistency printed;  // against where the print's corners are
  Consistency square;   // against those of the square that fits them best
  double pose_error = 0.0;
  int photos = 0;
  int found = 0;
  for (const double axis_deg : {0.0, 45.0, 90.0}) {
    for (const double tilt_deg : {0.0, 20.0, 40.0}) {
      for (const double direction : {1.0, -1.0}) {
        const int id = 3 * ++photos;
        const MarkerPhoto photo(dictionary(), {.id = id,
                                               .side_px = side_px,
                                               .tilt_deg = tilt_deg,
                                               .blur_px = 0.6,
                                               .bend_radius = direction * radius,
                                               .bend_axis_deg = axis_deg,
                                               .seed = static_cast<std::uint64_t>(photos)});
        const auto seen = detect(photo, id);
        if (!seen) continue;
        ++found;
        const double focal_px = photo.camera().focalLength();
        const Transform truth = squareOf(photo);
        std::array<Eigen::Vector3d, 4> flat = slam::markerCorners(MarkerPhoto::kSize_m);
        for (Eigen::Vector3d& corner : flat) corner = truth * corner;
        printed.add(*seen, normalizedOf(photo.corners_c()), focal_px);
        square.add(*seen, normalizedOf(flat), focal_px);
        pose_error += poseError(*seen, truth, focal_px);
      }
    }
  }
  EXPECT_EQ(found, photos);
  ASSERT_GT(found, 0);
  EXPECT_LT(printed.rms_px(), 0.1);
  EXPECT_LT(printed.mean(), 2.0);
  EXPECT_LT(square.mean(), 6.0);
  EXPECT_LT(pose_error / found, 3.0);
}

INSTANTIATE_TEST_SUITE_P(Radii, BentPaper,
                         ::testing::Values(Bent{40, 100}, Bent{20, 100}, Bent{10, 100},
                                           Bent{5, 100}, Bent{20, 200}, Bent{10, 200}),
                         [](const auto& param_info) {
                           return "Radius" +
                                  std::to_string(static_cast<int>(param_info.param.radius)) +
                                  "Side" +
                                  std::to_string(static_cast<int>(param_info.param.side_px));
                         });

TEST(FlatPaper, HasNoBow) {
  const MarkerPhoto photo(dictionary(), {.id = 3, .side_px = 100.0, .tilt_deg = 30.0});
  const auto seen = detect(photo, 3);
  ASSERT_TRUE(seen);
  for (const Eigen::Matrix2d& covariance : seen->covariance) {
    EXPECT_LT(photo.camera().focalLength() * std::sqrt(0.5 * covariance.trace()), 0.05);
  }
}

// Small markers, turned anyhow, whose margin is hardly wider than their edges are blurred, and one
// that is narrower than most. Corners lay inwards by 0.04 to 0.06 and 0.18 pixels while nobody
// knew what was behind the paper.
TEST(NarrowMargin, OfSmallMarkersMovesNoCorner) {
  constexpr int kPhotos = 100;
  for (const double quiet_zone : {0.7, 1.0, 3.0}) {
    for (const double side_px : {16.0, 20.0}) {
      Views views;
      for (int i = 0; i < kPhotos; ++i) {
        views.add({.id = i,
                   .side_px = side_px,
                   .blur_px = 0.6,
                   .quiet_zone = quiet_zone,
                   .seed = static_cast<std::uint64_t>(i)});
      }
      ASSERT_GT(views.found, 3 * kPhotos / 4) << quiet_zone << ' ' << side_px;
      EXPECT_LT(std::abs(views.corners.meanInwards_px()), 0.035) << quiet_zone << ' ' << side_px;
      EXPECT_LT(views.corners.rms_px(), 0.05) << quiet_zone << ' ' << side_px;
      EXPECT_LT(views.corners.mean(), 1.0) << quiet_zone << ' ' << side_px;
    }
  }
}

// What is behind the paper reaches into the blur of the edge.
TEST(NarrowMargin, ShowsInTheCovariance) {
  for (const auto& [side_px, blur_px] : {Blurred{100, 2}, Blurred{200, 3}, Blurred{200, 4}}) {
    const Views views =
        look({.side_px = side_px, .blur_px = blur_px, .quiet_zone = 0.3}, {0.0, 30.0});
    EXPECT_EQ(views.found, views.photos) << side_px << ' ' << blur_px;
    ASSERT_GT(views.found, 0);
    EXPECT_LT(views.corners.mean(), 2.5) << side_px << ' ' << blur_px;
  }
}

}  // namespace
}  // namespace waymark
