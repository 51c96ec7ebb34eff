#include "tools/evaluation/evaluation.h"

#include <cmath>

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

constexpr std::int64_t kPeriod_ns = 20'000'000;

slam::Transform someMotion() {
  slam::Vector6d delta;
  delta << 1.0, -2.0, 0.5, 0.4, -0.9, 1.3;
  return slam::Transform{}.retract(delta);
}

// A winding path, one pose a centimetre.
io::Trajectory path(int count) {
  io::Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    const double s = 0.01 * i;
    slam::Vector6d delta;
    delta << std::cos(s), std::sin(s), 0.1 * std::sin(3.0 * s), 0.2 * s, 0.1, -0.3 * s;
    trajectory.push_back({i * kPeriod_ns, slam::Transform{}.retract(delta)});
  }
  return trajectory;
}

io::Trajectory moved(io::Trajectory trajectory, const slam::Transform& T) {
  for (io::StampedPose& pose : trajectory) pose.T_w_c = T * pose.T_w_c;
  return trajectory;
}

TEST(Evaluation, StatisticsOfKnownNumbers) {
  const ErrorStatistics s = errorStatistics({4.0, 1.0, 3.0, 2.0});
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(7.5));
  EXPECT_DOUBLE_EQ(s.median, 2.5);
  EXPECT_DOUBLE_EQ(s.max, 4.0);
}

TEST(Evaluation, AnotherWorldFrameIsNoError) {
  const io::Trajectory truth = path(200);
  const auto errors = compareTrajectories(truth, moved(truth, someMotion()), {});
  ASSERT_TRUE(errors.ok());
  EXPECT_EQ(errors->matched, 200U);
  EXPECT_DOUBLE_EQ(errors->coverage(), 1.0);
  EXPECT_LT(errors->ate_m.max, 1e-9);
  EXPECT_GT(errors->segments, 100U);
  EXPECT_LT(errors->t_rel_percent, 1e-6);
  EXPECT_LT(errors->r_rel_deg, 1e-6);
}

TEST(Evaluation, AteIsTheMeanDistance) {
  const io::Trajectory truth = path(200);
  io::Trajectory estimate = truth;
  // Up and down in turns: alignment cannot remove it.
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    estimate[i].T_w_c.p.z() += i % 2 == 0 ? 0.003 : -0.003;
  }
  const auto errors = compareTrajectories(truth, estimate, {});
  ASSERT_TRUE(errors.ok());
  EXPECT_NEAR(errors->ate_m.mean, 0.003, 2e-5);
  EXPECT_NEAR(errors->ate_m.median, 0.003, 2e-5);
}

TEST(Evaluation, RelativeErrorsOfAWrongScaleAndASteadyTurn) {
  // Straight ahead, 1 cm a frame.
  io::Trajectory truth;
  io::Trajectory estimate;
  constexpr double kTurn_rad = 0.001;  // per frame: 0.025 rad over 25 cm
  for (int i = 0; i < 100; ++i) {
    truth.push_back({i * kPeriod_ns, {Eigen::Matrix3d::Identity(), {0.0, 0.0, 0.01 * i}}});
    estimate.push_back(
        {i * kPeriod_ns, {slam::expSo3({0.0, 0.0, kTurn_rad * i}), {0.0, 0.0, 0.01 * 1.02 * i}}});
  }
  const auto errors = compareTrajectories(truth, estimate, {});
  ASSERT_TRUE(errors.ok());
  // The 25 or 26 steps of a stretch, by rounding.
  EXPECT_NEAR(errors->t_rel_percent, 2.0, 0.1);
  EXPECT_NEAR(errors->r_rel_deg, 0.025 * 180.0 / 3.14159265, 0.06);
  EXPECT_NEAR(static_cast<double>(errors->segments), 75.0, 1.0);
}

TEST(Evaluation, PosesAreMatchedByTheNearestTime) {
  const io::Trajectory truth = path(50);
  io::Trajectory estimate;
  for (std::size_t i = 0; i < truth.size(); i += 2) {
    estimate.push_back(truth[i]);
    estimate.back().time_ns += 400'000;
    // A second, worse claim on the same frame, and one on none.
    estimate.push_back({truth[i].time_ns + 900'000, someMotion()});
    estimate.push_back({truth[i].time_ns + kPeriod_ns / 2, someMotion()});
  }
  const auto errors = compareTrajectories(truth, estimate, {});
  ASSERT_TRUE(errors.ok());
  EXPECT_EQ(errors->matched, 25U);
  EXPECT_DOUBLE_EQ(errors->coverage(), 0.5);
  EXPECT_LT(errors->ate_m.max, 1e-9);
}

TEST(Evaluation, NothingInCommonIsAnError) {
  io::Trajectory late = path(10);
  for (io::StampedPose& pose : late) pose.time_ns += 3600 * 1'000'000'000L;
  EXPECT_FALSE(compareTrajectories(path(10), late, {}).ok());
  EXPECT_FALSE(compareTrajectories(path(10), {}, {}).ok());
  EXPECT_FALSE(compareTrajectories({}, path(10), {}).ok());
  EXPECT_FALSE(compareMaps({}, {}).ok());
}

TEST(Evaluation, TheNearestPoseInTime) {
  const io::Trajectory trajectory = path(10);
  EXPECT_EQ(nearestPose(trajectory, 3 * kPeriod_ns + 400, 1000), &trajectory[3]);
  EXPECT_EQ(nearestPose(trajectory, 4 * kPeriod_ns - 400, 1000), &trajectory[4]);
  EXPECT_EQ(nearestPose(trajectory, -900, 1000), trajectory.data());
  EXPECT_EQ(nearestPose(trajectory, 9 * kPeriod_ns + 900, 1000), &trajectory[9]);
  EXPECT_EQ(nearestPose(trajectory, 3 * kPeriod_ns + 5000, 1000), nullptr);
  EXPECT_EQ(nearestPose({}, 0, 1000), nullptr);
}

io::MarkerCorners marker(int id, const slam::Transform& T_w_m) {
  io::MarkerCorners m{id, 0.1, slam::markerCorners(0.1)};
  for (Eigen::Vector3d& corner : m.corners) corner = T_w_m * corner;
  return m;
}

// Frames 0 to 9: marker 1 is mapped and large in the even ones, small in frame 3; marker 2 is
// large in frame 5 but not mapped; marker 3 is mapped and large beside marker 1 in frame 0.
TEST(Evaluation, CoverageCountsFramesWithALargeMappedMarkerInView) {
  std::vector<io::VisibleMarker> visible = {
      {3 * kPeriod_ns, 1, 19.0}, {5 * kPeriod_ns, 2, 80.0}, {0, 3, 25.0}};
  for (int i = 0; i < 10; i += 2) visible.push_back({i * kPeriod_ns, 1, 20.0});
  const std::vector<io::MarkerCorners> map = {marker(1, {}), marker(3, {})};
  io::Trajectory estimate = path(10);
  EXPECT_EQ(viewCoverage(visible, map, estimate, {}).frames, 5U);
  EXPECT_DOUBLE_EQ(viewCoverage(visible, map, estimate, {}).share(), 1.0);
  estimate.erase(estimate.begin() + 4);  // one that counts
  estimate.erase(estimate.begin() + 3);  // one that does not
  EXPECT_EQ(viewCoverage(visible, map, estimate, {}).localized, 4U);
  EXPECT_EQ(viewCoverage(visible, map, {}, {}).localized, 0U);
  EXPECT_EQ(viewCoverage({}, map, estimate, {}).frames, 0U);
}

TEST(Evaluation, AceComparesCommonMarkers) {
  std::vector<io::MarkerCorners> truth;
  std::vector<io::MarkerCorners> estimate;
  for (int id = 0; id < 6; ++id) {
    slam::Vector6d delta;
    delta << 0.3 * id, 0.1 * id * id, 0.0, 0.2 * id, 0.0, 0.1;
    const slam::Transform T_w_m = slam::Transform{}.retract(delta);
    if (id != 5) truth.push_back(marker(id, T_w_m));
    if (id != 2) estimate.push_back(marker(id, someMotion() * T_w_m));
  }
  const auto exact = compareMaps(truth, estimate);
  ASSERT_TRUE(exact.ok());
  EXPECT_EQ(exact->common, 4U);
  EXPECT_EQ(exact->missing, std::vector<int>{2});
  EXPECT_EQ(exact->unknown, std::vector<int>{5});
  EXPECT_LT(exact->ace_m.max, 1e-9);

  // 2 mm between neighbouring corners, up and down: the alignment cannot remove it.
  for (io::MarkerCorners& m : estimate) {
    for (std::size_t i = 0; i < 4; ++i) {
      m.corners[i] += someMotion().R * Eigen::Vector3d(0.0, 0.0, i % 2 == 0 ? 0.002 : -0.002);
    }
  }
  const auto rough = compareMaps(truth, estimate);
  ASSERT_TRUE(rough.ok());
  EXPECT_NEAR(rough->ace_m.mean, 0.002, 2e-5);
}

// Each piece of a map has a world of its own.
TEST(Evaluation, PiecesAreAlignedEachByItself) {
  std::vector<io::MarkerCorners> truth;
  std::vector<io::MarkerCorners> estimate;
  for (int id = 0; id < 6; ++id) {
    const slam::Transform T_w_m = slam::Transform{}.retract(slam::Vector6d::Constant(0.3 * id));
    truth.push_back(marker(id, T_w_m));
    estimate.push_back(marker(id, id < 3 ? T_w_m : someMotion() * T_w_m));
  }
  const auto as_one = compareMaps(truth, estimate);
  ASSERT_TRUE(as_one.ok());
  EXPECT_EQ(as_one->pieces.size(), 1U);
  EXPECT_GT(as_one->ace_m.mean, 0.1);
  for (io::MarkerCorners& m : estimate) m.piece = m.id < 3 ? 0 : 7;
  const auto apart = compareMaps(truth, estimate);
  ASSERT_TRUE(apart.ok());
  EXPECT_EQ(apart->common, 6U);
  ASSERT_EQ(apart->pieces.size(), 2U);
  EXPECT_EQ(apart->pieces[1].piece, 7);
  EXPECT_EQ(apart->pieces[1].markers, 3U);
  EXPECT_LT(apart->pieces[1].ace_m.max, 1e-9);
  EXPECT_LT(apart->ace_m.max, 1e-9);
}

}  // namespace
}  // namespace waymark::tools
