#include "simulator/recording.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "io/text/text_file.h"
#include "io/trajectory.h"
#include "simulator/truth_files.h"
#include "slam/detection/marker_detection.h"
#include "tests/temporary_directory.h"

namespace waymark::simulator {
namespace {

namespace fs = std::filesystem;

class RecordingTest : public ::testing::Test {
 protected:
  RecordingTest() {
    Options options;
    options.size = ImageSize{320, 240};
    options.duration_s = 0.1;  // six frames
    options.doubled_id = 7;
    auto simulation = Simulation::create(options, Ending::kOfTheScene);
    simulation_ = std::move(*simulation);
  }

  cv::Mat rendered(std::int64_t frame) const {
    Simulation::Workspace workspace;
    cv::Mat image(240, 320, CV_8U);
    simulation_->render(frame, &workspace, image.data);
    return image;
  }

  const waymark::testing::TemporaryDirectory temporary_;
  const fs::path directory_ = temporary_ / "recording";
  std::unique_ptr<const Simulation> simulation_;
};

TEST_F(RecordingTest, VideoKeepsEveryPixel) {
  const Status status = record(*simulation_, {.directory = directory_, .progress = {}});
  ASSERT_TRUE(status.ok()) << status.error().message;
  cv::VideoCapture video((directory_ / "frames.avi").string());
  EXPECT_DOUBLE_EQ(video.get(cv::CAP_PROP_FPS), 60.0);
  cv::Mat frame;
  std::int64_t k = 0;
  for (; video.read(frame); ++k) {
    if (frame.channels() == 3) cv::cvtColor(frame, frame, cv::COLOR_BGR2GRAY);
    EXPECT_EQ(cv::norm(frame, rendered(k), cv::NORM_INF), 0.0) << "frame " << k;
  }
  EXPECT_EQ(k, 6);
}

TEST_F(RecordingTest, ImagesKeepEveryPixelAndTheirTimes) {
  const RecordingOptions options{.directory = directory_, .images = true, .progress = {}};
  const Status status = record(*simulation_, options);
  ASSERT_TRUE(status.ok()) << status.error().message;
  std::ifstream times(directory_ / "frames" / "frames.txt");
  std::string name;
  double seconds = 0.0;
  std::int64_t k = 0;
  for (; times >> name >> seconds; ++k) {
    EXPECT_NEAR(seconds, static_cast<double>(k) / 60.0, 1e-9);
    const cv::Mat image = cv::imread((directory_ / "frames" / name).string(), cv::IMREAD_UNCHANGED);
    EXPECT_EQ(cv::norm(image, rendered(k), cv::NORM_INF), 0.0) << name;
  }
  EXPECT_EQ(k, 6);
  EXPECT_EQ(record(*simulation_, options).error().message,
            (directory_ / "frames").string() + ": exists already");
}

TEST_F(RecordingTest, TruthFilesSayWhatWasSimulated) {
  ASSERT_TRUE(record(*simulation_, {.directory = directory_, .progress = {}}).ok());

  const cv::FileStorage calib((directory_ / "calib.yml").string(), cv::FileStorage::READ);
  cv::Mat matrix;
  cv::Mat distortion;
  calib["camera_matrix"] >> matrix;
  calib["distortion_coefficients"] >> distortion;
  const slam::Calibration& camera = simulation_->camera();
  EXPECT_EQ(static_cast<int>(calib["image_width"]), camera.width);
  EXPECT_DOUBLE_EQ(matrix.at<double>(0, 0), camera.fx);
  EXPECT_DOUBLE_EQ(matrix.at<double>(1, 2), camera.cy);
  EXPECT_DOUBLE_EQ(distortion.at<double>(0, 1), camera.distortion[1]);

  const Result<io::Trajectory> trajectory = io::readTrajectory(directory_ / "gt_traj.txt");
  ASSERT_TRUE(trajectory) << trajectory.error().message;
  ASSERT_EQ(trajectory->size(), 6U);
  for (std::size_t k = 0; k < trajectory->size(); ++k) {
    const io::StampedPose& read = (*trajectory)[k];
    const slam::Transform truth = simulation_->poseAt(static_cast<std::int64_t>(k));
    EXPECT_NEAR(static_cast<double>(read.time_ns), 1e9 * static_cast<double>(k) / 60.0, 1.0);
    EXPECT_LT((read.T_w_c.p - truth.p).norm(), 1e-8);
    EXPECT_LT(slam::rotationDistance(read.T_w_c.R, truth.R), 1e-9);
  }

  const auto map = nlohmann::json::parse(std::ifstream(directory_ / "gt_map.json"));
  ASSERT_EQ(map["markers"].size(), 47U);  // 48, two of them with one id
  for (const auto& entry : map["markers"]) {
    const auto& markers = simulation_->markers();
    const auto marker = std::find_if(markers.begin(), markers.end(), [&](const Marker& m) {
      return m.id == entry["id"].get<int>();
    });
    ASSERT_NE(marker, markers.end());
    const auto corners = slam::markerCorners(entry["size"].get<double>());
    for (std::size_t i = 0; i < 4; ++i) {
      const auto& c = entry["corners"][i];
      const Eigen::Vector3d read(c[0].get<double>(), c[1].get<double>(), c[2].get<double>());
      EXPECT_LT((read - marker->T_w_m * corners[i]).norm(), 1e-8);
    }
  }
  const auto used = nlohmann::json::parse(std::ifstream(directory_ / "simulation.json"));
  EXPECT_EQ(used["doubled_id"], 7);
  EXPECT_EQ(used["rate_hz"], 60.0);
}

TEST_F(RecordingTest, TheTruthAloneIsTheSame) {
  ASSERT_TRUE(record(*simulation_, {.directory = directory_, .progress = {}}).ok());
  const fs::path alone = temporary_ / "truth";
  const Status status = recordTruth(*simulation_, alone);
  ASSERT_TRUE(status.ok()) << status.error().message;
  EXPECT_FALSE(fs::exists(alone / "frames.avi"));
  for (const char* file :
       {"calib.yml", "gt_traj.txt", "gt_map.json", "gt_visible.csv", "simulation.json"}) {
    EXPECT_EQ(*io::readTextFile(alone / file), *io::readTextFile(directory_ / file)) << file;
  }
}

// By frame: what visibleMarkers() says, at the size it has in the image; nothing in the dark.
TEST_F(RecordingTest, VisibilityFollowsCameraAndLight) {
  Options options = simulation_->options();
  options.blackouts = {{2.5 / 60.0, 4.5 / 60.0}};  // frames 3 and 4
  const auto dark = Simulation::create(options, Ending::kOfTheScene);
  ASSERT_TRUE(dark.ok());
  std::map<std::int64_t, std::size_t> count;
  for (const io::VisibleMarker& marker : trueVisibility(**dark)) {
    ++count[marker.time_ns];
    // 12.3 cm at 1 to 5 m and 256 pixels' focal length, seen at up to 60 degrees.
    EXPECT_GT(marker.side_px, 3.0);
    EXPECT_LT(marker.side_px, 35.0);
  }
  for (std::int64_t k = 0; k < 6; ++k) {
    EXPECT_EQ((*dark)->isDark(k), k == 3 || k == 4);
    const std::size_t seen = (*dark)->visibleMarkers(k).size();
    EXPECT_GT(seen, 0U);
    EXPECT_EQ(count[std::llround(1e9 * (*dark)->timeOf(k))], (*dark)->isDark(k) ? 0 : seen);
  }
}

TEST_F(RecordingTest, LeavesNothingBehindWhereItCannotWrite) {
  const Status status = record(*simulation_, {.directory = "/dev/null/recording", .progress = {}});
  ASSERT_FALSE(status.ok());
  EXPECT_NE(status.error().message.find("/dev/null/recording"), std::string::npos);
}

}  // namespace
}  // namespace waymark::simulator
