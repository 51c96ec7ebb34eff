#include "io/trajectory.h"

#include <string>

#include <gtest/gtest.h>

#include "io/text/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

TEST(Trajectory, WrittenPosesReadBack) {
  const TemporaryDirectory directory;
  Trajectory trajectory;
  for (int i = 0; i < 20; ++i) {
    slam::Vector6d delta;
    delta << 0.1 * i, -2.0, 1e-6 * i, 0.3 * i, 0.1, -0.2 * i;
    trajectory.push_back({1560889276319020123 + i * 33'333'333L, slam::Transform{}.retract(delta)});
  }
  ASSERT_TRUE(writeTrajectory(directory / "t.tum", trajectory).ok());
  const Result<Trajectory> back = readTrajectory(directory / "t.tum");
  ASSERT_TRUE(back.ok()) << back.error().message;
  ASSERT_EQ(back->size(), trajectory.size());
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    const StampedPose& a = trajectory[i];
    const StampedPose& b = (*back)[i];
    EXPECT_EQ(a.time_ns, b.time_ns);
    EXPECT_LT((a.T_w_c.p - b.T_w_c.p).norm(), 1e-9);
    EXPECT_LT(slam::rotationDistance(a.T_w_c.R, b.T_w_c.R), 1e-11);
  }
}

TEST(Trajectory, QuaternionIsWrittenLast) {
  const slam::Transform T =
      slam::Transform::fromQuaternion(Eigen::Quaterniond(0.8, 0.6, 0.0, 0.0), {1.0, 2.0, 3.0});
  EXPECT_NE(formatTrajectory({{1, T}}).find(
                "0.000000001 1.000000000 2.000000000 3.000000000 0.600000000000 "
                "0.000000000000 0.000000000000 0.800000000000\n"),
            std::string::npos);
}

TEST(Trajectory, FaultsNameTheLine) {
  const TemporaryDirectory directory;
  for (const auto& [text, complaint] : {
           std::pair{"# note\n\n1 0 0 0 0 0 0\n", "t.tum:3: has 7 fields"},
           std::pair{"now 0 0 0 0 0 0 1\n", "t.tum:1: 'now' is not a time"},
           std::pair{"1 0 x 0 0 0 0 1\n", "t.tum:1: 'x' is not a finite number"},
           std::pair{"1 0 0 nan 0 0 0 1\n", "t.tum:1: 'nan' is not a finite number"},
           std::pair{"1 0 0 0 0 0 0 0\n", "t.tum:1: the quaternion's length is 0"},
       }) {
    ASSERT_TRUE(writeTextFile(directory / "t.tum", text).ok());
    const Result<Trajectory> trajectory = readTrajectory(directory / "t.tum");
    ASSERT_FALSE(trajectory.ok()) << text;
    EXPECT_NE(trajectory.error().message.find(complaint), std::string::npos)
        << trajectory.error().message;
  }
  EXPECT_FALSE(readTrajectory(directory / "missing.tum").ok());
}

}  // namespace
}  // namespace waymark::io
