#include "simulator/observed_corners.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "simulator/simulation.h"

namespace waymark::simulator {
namespace {

class ObservedCorners : public ::testing::Test {
 protected:
  ObservedCorners() {
    auto simulation = Simulation::create({}, Ending::kClosedLoop);
    simulation_ = std::move(*simulation);
    camera_.emplace(simulation_->camera());
  }

  [[nodiscard]] std::vector<slam::MarkerDetection> observe(
      std::int64_t frame, const ObservationOptions& options = {}) const {
    return observeCorners(*camera_, simulation_->poseAt(frame), simulation_->markers(),
                          static_cast<std::uint64_t>(frame), options);
  }

  std::unique_ptr<const Simulation> simulation_;
  std::optional<slam::CameraModel> camera_;
};

// The room has no corners to look round, so what is in view is what the simulation sees, and those
// whose paper is cut by the image's border.
TEST_F(ObservedCorners, SeesWhatTheSimulationSees) {
  for (std::int64_t frame = 0; frame < 1800; frame += 90) {
    const auto detections = observe(frame);
    EXPECT_TRUE(std::is_sorted(detections.begin(), detections.end(),
                               [](const auto& a, const auto& b) { return a.id < b.id; }));
    std::size_t found = 0;
    for (const Marker& marker : simulation_->visibleMarkers(frame)) {
      found += std::count_if(detections.begin(), detections.end(),
                             [&](const auto& detection) { return detection.id == marker.id; });
    }
    EXPECT_EQ(found, simulation_->visibleMarkers(frame).size());
    EXPECT_LE(detections.size(), found + 4);
  }
}

// Errors against the truth: as large as the covariance says, and without bias.
TEST_F(ObservedCorners, NoiseIsWhatTheCovarianceSays) {
  const ObservationOptions options{.sigma_px = 0.2, .seed = 5};
  Eigen::Vector2d bias = Eigen::Vector2d::Zero();  // pixels
  double squared_px2 = 0.0;
  double whitened = 0.0;
  int count = 0;
  for (std::int64_t frame = 0; frame < 1800; frame += 10) {
    const slam::Transform T_c_w = simulation_->poseAt(frame).inverse();
    for (const slam::MarkerDetection& detection : observe(frame, options)) {
      const Marker& marker = simulation_->markers()[static_cast<std::size_t>(detection.id)];
      ASSERT_EQ(marker.id, detection.id);
      const auto corners = slam::markerCorners(marker.size_m);
      for (std::size_t k = 0; k < 4; ++k) {
        const Eigen::Vector3d p_c = T_c_w * (marker.T_w_m * corners[k]);
        const Eigen::Vector2d error_px = detection.pixels[k] - *camera_->project(p_c);
        const Eigen::Vector2d error =
            detection.normalized[k] - Eigen::Vector2d(p_c.x() / p_c.z(), p_c.y() / p_c.z());
        bias += error_px;
        squared_px2 += error_px.squaredNorm();
        whitened += error.dot(detection.covariance[k].inverse() * error);
        ++count;
      }
    }
  }
  ASSERT_GT(count, 3000);
  EXPECT_LT((bias / count).norm(), 0.02);
  EXPECT_NEAR(squared_px2 / count, 2.0 * 0.04, 0.005);
  EXPECT_NEAR(whitened / count, 2.0, 0.1);
}

TEST_F(ObservedCorners, SameFrameAndSeedSameNoise) {
  const auto first = observe(30);
  ASSERT_FALSE(first.empty());
  EXPECT_EQ(first[0].pixels[0], observe(30)[0].pixels[0]);
  EXPECT_NE(first[0].pixels[0], observe(30, {.seed = 2})[0].pixels[0]);
  const auto exact = observe(30, {.sigma_px = 1e-9});
  const auto later = observeCorners(*camera_, simulation_->poseAt(30), simulation_->markers(), 31,
                                    {.sigma_px = 0.1});
  EXPECT_NE(first[0].pixels[0] - exact[0].pixels[0], later[0].pixels[0] - exact[0].pixels[0]);
}

TEST_F(ObservedCorners, NothingBehindAndNothingFromBehind) {
  const Marker& marker = simulation_->markers().front();
  const auto from = [&](double distance_m, bool towards) {
    // In front of the print or behind it, looking along its axis.
    slam::Transform T_m_c;
    T_m_c.p = {0.0, 0.0, distance_m};
    const bool flip = (distance_m > 0.0) == towards;
    if (flip) T_m_c.R = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    return observeCorners(*camera_, marker.T_w_m * T_m_c, {&marker, 1}, 0, {}).size();
  };
  EXPECT_EQ(from(1.0, true), 1U);
  EXPECT_EQ(from(1.0, false), 0U);
  EXPECT_EQ(from(-1.0, true), 0U);
  EXPECT_EQ(from(-1.0, false), 0U);
}

}  // namespace
}  // namespace waymark::simulator
