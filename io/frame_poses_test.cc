#include "io/frame_poses.h"

#include <vector>

#include <gtest/gtest.h>

#include "io/text/number_text.h"

namespace waymark::io {
namespace {

std::vector<FramePose> oneOfEach() {
  slam::PoseEstimate pose;
  pose.T_w_c.p = {1.5, -2.0, 0.25};
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) pose.covariance(i, j) = 0.5 * (i + j) + 1.0;
  }
  pose.source = slam::PoseSource::kMarkers;
  pose.markers_used = 3;
  pose.reprojection_rms_px = 0.125;
  pose.ambiguity_ratio = 9.5;
  return {{1'500'000'000, 0, FrameStatus::kTracking, pose, ""},
          {1'533'333'333, 1, FrameStatus::kRelocalizing, {}, "no marker in view"},
          {2'000'000'000, 2, FrameStatus::kInitializing, {}, "there is \"no\" map, and none"},
          {2'100'000'000, 3, FrameStatus::kLost, {}, ""}};
}

TEST(FramePoses, HaveALineForEachFrame) {
  const auto text = formatFramePoses(oneOfEach());
  const auto lines = split(text, '\n');
  ASSERT_EQ(lines.size(), 6U) << "the columns' names, and an end";
  EXPECT_EQ(lines[0],
            "t,frame,status,source,piece,px,py,pz,qw,qx,qy,qz,c00,c01,c02,c03,c04,c05,c11,c12,c13,"
            "c14,c15,c22,c23,c24,c25,c33,c34,c35,c44,c45,c55,markers,features,rms_px,reason,"
            "ambiguity");
  const auto names = split(lines[0], ',');
  const auto tracked = split(lines[1], ',');
  ASSERT_EQ(tracked.size(), names.size());
  EXPECT_EQ(lines[1],
            "1.500000000,0,tracking,markers,0,1.500000000,-2.000000000,0.250000000,"
            "1.000000000000,0.000000000000,0.000000000000,0.000000000000,"
            "1.0,1.5,2.0,2.5,3.0,3.5,2.0,2.5,3.0,3.5,4.0,3.0,3.5,4.0,4.5,4.0,4.5,5.0,5.0,5.5,6.0,3,"
            "0,0.125,,"
            "9.5");
  const auto lost = split(lines[2], ',');
  ASSERT_EQ(lost.size(), names.size());
  EXPECT_EQ(lost[2], "relocalizing");
  for (std::size_t i = 3; i < names.size(); ++i) {
    EXPECT_EQ(lost[i], names[i] == "reason" ? "no marker in view" : "") << names[i];
  }
  EXPECT_NE(lines[3].find(",\"there is \"\"no\"\" map, and none\","), lines[3].npos);
  EXPECT_EQ(lines[4].substr(0, 20), "2.100000000,3,lost,,");
}

TEST(FramePoses, EachPieceOfTheMapHasItsOwnTrajectory) {
  std::vector<FramePose> frames = oneOfEach();
  frames.push_back(frames[0]);
  frames.back().time_ns = 2'200'000'000;
  frames.back().pose->piece = 4;
  EXPECT_NE(formatFramePoses(frames).find("\n2.200000000,0,tracking,markers,4,"),
            std::string::npos);
  const auto trajectories = trajectoriesOf(frames);
  ASSERT_EQ(trajectories.size(), 2U);
  EXPECT_EQ(trajectories.at(0).at(0).time_ns, 1'500'000'000);
  EXPECT_EQ(trajectories.at(4).at(0).time_ns, 2'200'000'000);
}

TEST(FramePoses, TheTrajectoryHasThoseWithAPose) {
  const auto trajectories = trajectoriesOf(oneOfEach());
  ASSERT_EQ(trajectories.size(), 1U);
  const Trajectory& trajectory = trajectories.at(0);
  ASSERT_EQ(trajectory.size(), 1U);
  EXPECT_EQ(trajectory[0].time_ns, 1'500'000'000);
  EXPECT_EQ(trajectory[0].T_w_c.p.x(), 1.5);
}

}  // namespace
}  // namespace waymark::io
