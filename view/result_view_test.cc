#include "view/result_view.h"

#include <fstream>

#include <gtest/gtest.h>

#include "io/frame_poses.h"
#include "io/maps/map_file.h"
#include "io/text/text_file.h"
#include "io/trajectory.h"
#include "tests/temporary_directory.h"

namespace waymark::view {
namespace {

using io::Json;

TEST(CsvFields, MayHaveCommasAndQuotes) {
  EXPECT_EQ(csvFields(""), std::vector<std::string>{""});
  EXPECT_EQ(csvFields("a,,b"), (std::vector<std::string>{"a", "", "b"}));
  EXPECT_EQ(csvFields("1,\"no \"\"map\"\", yet\",\r"),
            (std::vector<std::string>{"1", "no \"map\", yet", ""}));
}

// Five frames on a line, of which the third has no pose; the truth is 0.5 m beside, and its last
// pose 3 mm off.
class ResultViewTest : public ::testing::Test {
 protected:
  ResultViewTest() {
    slam::Map map;
    map.dictionary = "4X4_50";
    map.addMarker(7, 0.2);
    map.place(7, slam::Transform{}, std::nullopt, slam::Matrix6d::Zero());
    map.addMarker(9, 0.2);
    slam::PicturePrint print;
    print.name = "poster";
    print.width_m = 0.6;
    print.height_m = 0.4;
    map.place(map.addPicture(print).id, slam::Transform{}, std::nullopt, slam::Matrix6d::Zero());
    write("map.json", io::formatMap(map, std::nullopt));
    std::vector<io::FramePose> frames(5);
    io::Trajectory truth;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      frames[i].time_ns = static_cast<std::int64_t>(i) * 100'000'000;
      frames[i].frame = i;
      const Eigen::Vector3d p(0.1 * static_cast<double>(i), i % 2 == 0 ? 0.0 : 0.05, 0.0);
      io::StampedPose pose{frames[i].time_ns, {}};
      pose.T_w_c.p = p + Eigen::Vector3d(0.5, i == 4 ? 0.003 : 0.0, 0.0);
      truth.push_back(pose);
      if (i == 2) {
        frames[i].reason = "no map, yet";
        continue;
      }
      frames[i].status = io::FrameStatus::kTracking;
      frames[i].pose.emplace();
      frames[i].pose->source = slam::PoseSource::kMarkers;
      frames[i].pose->T_w_c.p = p;
      frames[i].pose->covariance = 1e-6 * slam::Matrix6d::Identity();
      frames[i].pose->markers_used = 3;
    }
    write("poses.csv", io::formatFramePoses(frames));
    write("poses_final.csv", io::formatFramePoses(frames));
    write("truth.tum", io::formatTrajectory(truth));
  }
  void write(const char* name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
  }
  testing::TemporaryDirectory directory_;
};

TEST_F(ResultViewTest, HasTheMapAndWhatBecameOfEachFrame) {
  const auto view = readResultView(directory_.path(), {});
  ASSERT_TRUE(view) << view.error().message;
  ASSERT_EQ(view->map.size(), 1U);
  EXPECT_EQ(view->map[0].dictionary, "4X4_50");
  ASSERT_EQ(view->map[0].markers.size(), 1U);
  EXPECT_EQ(view->map[0].markers[0].id, 7);
  ASSERT_EQ(view->map[0].unposed.size(), 1U);
  ASSERT_EQ(view->natural_map.size(), 1U);
  ASSERT_EQ(view->natural_map[0].markers.size(), 1U);
  EXPECT_EQ(view->natural_map[0].markers[0].name, "poster");
  EXPECT_EQ(view->natural_map[0].markers[0].width, 0.6);
  EXPECT_EQ(view->natural_map[0].markers[0].height, 0.4);
  const Json& tracks = view->result["tracks"];
  ASSERT_EQ(tracks.size(), 2U);
  EXPECT_EQ(tracks[0]["name"], "live");
  ASSERT_EQ(tracks[0]["poses"].size(), 5U);
  EXPECT_EQ(tracks[0]["poses"][2], Json::parse(R"([0.2, "no map, yet"])"));
  EXPECT_NEAR(tracks[1]["poses"][3][1], 0.3, 1e-9);
  EXPECT_NEAR(tracks[1]["poses"][3][9], 1e-3, 1e-9) << "sigma";
  EXPECT_TRUE(view->result["errors"].empty());
}

TEST_F(ResultViewTest, MeasuresErrorsAgainstATruthInAnotherWorld) {
  const auto view = readResultView(directory_.path(), directory_ / "truth.tum");
  ASSERT_TRUE(view) << view.error().message;
  ASSERT_EQ(view->result["errors"].size(), 2U);
  const Json& errors = view->result["errors"][1];
  EXPECT_EQ(errors["name"], "final");
  EXPECT_EQ(errors["points"].size(), 4U);
  EXPECT_GT(errors["max_m"], 0.0005);
  EXPECT_LT(errors["max_m"], 0.003);
  ASSERT_EQ(view->result["truth"].size(), 5U);
  EXPECT_NEAR(view->result["truth"][0][1], 0.0, 0.003) << "in the world of the estimate";
}

TEST_F(ResultViewTest, FaultsAreNamed) {
  EXPECT_NE(readResultView(directory_ / "none", {}).error().message.find("none/map.json"),
            std::string::npos);
  write("poses.csv", "t,frame,source,px\n0.1,0,markers,abc\n");
  EXPECT_NE(readResultView(directory_.path(), {}).error().message.find("poses.csv:2: "),
            std::string::npos);
}

}  // namespace
}  // namespace waymark::view
