#include "io/recorded_detections.h"

#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "io/calibrations/calibration_file.h"
#include "io/text/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

slam::CameraModel camera() {
  slam::Calibration c{
      .width = 640, .height = 480, .fx = 500.0, .fy = 500.0, .cx = 320.0, .cy = 240.0};
  c.distortion[0] = -0.3;
  return slam::CameraModel(c);
}

TEST(RecordedDetections, CornersAreReorderedAndUndistorted) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(writeTextFile(directory / "detections.csv",
                            "# t,id,...\n"
                            "2.5,9,1,100,200,110,200,110,190,100,190\n"
                            "2.5,4,0,320,240,330,240,330,230,320,230\n")
                  .ok());
  const auto recorded =
      readRecordedDetections(directory / "detections.csv", camera(), {.corner_sigma_px = 0.5});
  ASSERT_TRUE(recorded.ok()) << recorded.error().message;
  ASSERT_EQ(recorded->frames.size(), 1U);
  EXPECT_EQ(recorded->frames[0].time_ns, 2'500'000'000);
  ASSERT_EQ(recorded->frames[0].detections.size(), 2U);
  EXPECT_EQ(recorded->frames[0].detections[0].id, 4);
  const slam::MarkerDetection& detection = recorded->frames[0].detections[1];
  EXPECT_EQ(detection.id, 9);
  EXPECT_EQ(detection.hamming, 1);
  // Top-left, top-right, bottom-right, bottom-left; y points down.
  EXPECT_EQ(detection.pixels[0], Eigen::Vector2d(100, 190));
  EXPECT_EQ(detection.pixels[1], Eigen::Vector2d(110, 190));
  EXPECT_EQ(detection.pixels[2], Eigen::Vector2d(110, 200));
  EXPECT_EQ(detection.pixels[3], Eigen::Vector2d(100, 200));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_LT((camera().distort(detection.normalized[i]) - detection.pixels[i]).norm(), 1e-6);
  }
  // At the image centre half a pixel is 0.5 / 500.
  const Eigen::Matrix2d centre = recorded->frames[0].detections[0].covariance[3];
  EXPECT_NEAR(centre(0, 0), 1e-6, 1e-12);
  EXPECT_NEAR(centre(0, 1), 0.0, 1e-12);
}

TEST(RecordedDetections, FramesCsvNamesAlsoTheEmptyOnes) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(writeTextFile(directory / "frames.csv", "# t\n3\n1\n2\n").ok());
  ASSERT_TRUE(
      writeTextFile(directory / "detections.csv", "2,4,0,301,201,302,201,302,200,301,200\n").ok());
  const auto recorded = readRecordedDetections(directory / "detections.csv", camera());
  ASSERT_TRUE(recorded.ok()) << recorded.error().message;
  ASSERT_EQ(recorded->frames.size(), 3U);
  EXPECT_EQ(recorded->frames[0].time_ns, 1'000'000'000);
  EXPECT_TRUE(recorded->frames[0].detections.empty());
  EXPECT_EQ(recorded->frames[1].detections.size(), 1U);
}

// Detections as the detector makes them: sub-pixel corners, a covariance of its own for each.
std::vector<RecordedFrame> someFrames(const slam::CameraModel& camera) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> away(-3.0, 3.0);
  std::vector<RecordedFrame> frames = {{-1'000'000'001, {}}, {0, {}}, {33'333'333, {}}};
  for (const std::size_t frame : {0U, 2U}) {
    for (const int id : {3, 8}) {
      slam::MarkerDetection detection;
      detection.id = id;
      detection.hamming = id == 8 ? 1 : 0;
      for (std::size_t k = 0; k < 4; ++k) {
        const std::size_t column = k % 2;
        const std::size_t row = k / 2;
        const Eigen::Vector2d corner(200.0 + 30.0 * id + 60.0 * static_cast<double>(column),
                                     120.0 + 70.0 * static_cast<double>(row));
        detection.normalized[k] = *camera.undistort(corner + Eigen::Vector2d(away(rng), away(rng)));
        detection.pixels[k] = camera.distort(detection.normalized[k]);
        Eigen::Matrix2d root;
        root << 1e-4, 0.0, 3e-5 * away(rng), 2e-4;
        detection.covariance[k] = root * root.transpose();
      }
      frames[frame].detections.push_back(detection);
    }
  }
  return frames;
}

TEST(RecordedDetections, WhatWasWrittenReadsBack) {
  const TemporaryDirectory directory;
  const std::vector<RecordedFrame> written = someFrames(camera());
  ASSERT_TRUE(
      writeTextFile(directory / "detections.csv", formatRecordedDetections(written, camera()))
          .ok());
  ASSERT_TRUE(writeTextFile(directory / "frames.csv", formatFrameTimes(written)).ok());
  const auto read = readRecordedDetections(directory / "detections.csv", camera());
  ASSERT_TRUE(read.ok()) << read.error().message;
  ASSERT_EQ(read->frames.size(), written.size());
  for (std::size_t f = 0; f < written.size(); ++f) {
    EXPECT_EQ(read->frames[f].time_ns, written[f].time_ns);
    ASSERT_EQ(read->frames[f].detections.size(), written[f].detections.size());
    for (std::size_t d = 0; d < written[f].detections.size(); ++d) {
      const slam::MarkerDetection& was = written[f].detections[d];
      const slam::MarkerDetection& is = read->frames[f].detections[d];
      EXPECT_EQ(is.id, was.id);
      EXPECT_EQ(is.hamming, was.hamming);
      for (std::size_t k = 0; k < 4; ++k) {
        EXPECT_EQ(is.pixels[k], was.pixels[k]);
        EXPECT_LT((is.normalized[k] - was.normalized[k]).norm(), 1e-9);
        EXPECT_LT((is.covariance[k] - was.covariance[k]).norm(), 1e-7 * was.covariance[k].norm());
      }
    }
  }
}

TEST(RecordedDetections, CovariancesAreOfTheCornerTheyAreWrittenFor) {
  const TemporaryDirectory directory;
  // At the principal point a pixel is 1 / 500, and the lens does nothing.
  ASSERT_TRUE(writeTextFile(directory / "detections.csv",
                            "1,4,0,320,240,330,240,330,230,320,230,"
                            "0.04,0.01,0.09,1,0,1,1,0,1,1,0,1\n")
                  .ok());
  const auto recorded = readRecordedDetections(directory / "detections.csv", camera());
  ASSERT_TRUE(recorded.ok()) << recorded.error().message;
  const Eigen::Matrix2d bottom_left = recorded->frames[0].detections[0].covariance[3];
  EXPECT_NEAR(bottom_left(0, 0), 0.04 / 250'000.0, 1e-15);
  EXPECT_NEAR(bottom_left(0, 1), 0.01 / 250'000.0, 1e-15);
  EXPECT_NEAR(bottom_left(1, 0), 0.01 / 250'000.0, 1e-15);
  EXPECT_NEAR(bottom_left(1, 1), 0.09 / 250'000.0, 1e-15);
}

TEST(RecordedDetections, FaultsNameTheLine) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(writeTextFile(directory / "frames.csv", "1\n").ok());
  for (const auto& [text, complaint] :
       {std::pair{"1,4,0,1,1\n", ":1: has 5 fields"},
        std::pair{"\nnow,4,0,1,1,2,1,2,0,1,0\n", ":2: must begin with a time"},
        std::pair{"1,x,0,1,1,2,1,2,0,1,0\n", ":1: must begin with a time"},
        std::pair{"1,4,0,1,1,2,1,nan,0,1,0\n", ":1: corner 2 is not two finite numbers"},
        std::pair{"2,4,0,1,1,2,1,2,0,1,0\n", ":1: time 2.000000000 is not in"},
        std::pair{"1,4,0,1,1,2,1,2,0,1,0,1,0,1\n", ":1: has 14 fields"},
        std::pair{"1,4,0,1,1,2,1,2,0,1,0,1,0,1,1,0,1,1,2,1,1,0,1\n",
                  ":1: covariance of corner 2 is not"},
        std::pair{"1,4,0,1,1,2,1,2,0,1,0,1,0,1,-1,0,-1,1,0,1,1,0,1\n",
                  ":1: covariance of corner 1 is not"},
        std::pair{"1,4,0,1,1,2,1,2,0,1,0,1,0,1,1,0,1e300,1,0,1,1,0,1\n",
                  ":1: covariance of corner 1 is not"},
        std::pair{"9000000000,4,0,1,1,2,1,2,0,1,0\n", ":1: must begin with a time"},
        std::pair{"1,4,0,1,1,2,1,2,0,1,0,1,0,1,1,0,1,1,0,1,1,0,wide\n",
                  ":1: covariance of corner 3 is not"}}) {
    ASSERT_TRUE(writeTextFile(directory / "detections.csv", text).ok());
    const auto recorded = readRecordedDetections(directory / "detections.csv", camera());
    ASSERT_FALSE(recorded.ok()) << text;
    EXPECT_NE(recorded.error().message.find(std::string("detections.csv") + complaint),
              std::string::npos)
        << recorded.error().message;
  }
}

// Where two sides meet, a corner may be outside the image: one of very many does not make it
// larger.
TEST(RecordedDetections, AFewCornersBeyondTheImageDoNotMakeItLarger) {
  const TemporaryDirectory directory;
  std::string text;
  for (int i = 0; i < 100; ++i) {
    text += std::to_string(i) + ",4,0,600,470,610,470,610,460,600,460\n";
  }
  const auto extentOf = [&](const std::string& detections) {
    EXPECT_TRUE(writeTextFile(directory / "detections.csv", detections).ok());
    return readImageExtent(directory / "detections.csv");
  };
  auto extent = extentOf(text);
  ASSERT_TRUE(extent);
  EXPECT_EQ(extent->right_px, 610.0);
  EXPECT_EQ(extent->bottom_px, 470.0);
  extent = extentOf(text + "100,4,0,630,483,652,470,650,460,640,460\n");
  ASSERT_TRUE(extent);
  EXPECT_LT(extent->right_px, 650.0);
  EXPECT_EQ(extent->bottom_px, 470.0);
  extent = extentOf("100,4,0,630,483,652,470,650,460,640,460\n");
  ASSERT_TRUE(extent);
  EXPECT_EQ(extent->right_px, 652.0) << "of so few, all are as good";
}

TEST(RecordedDetections, RealRecordingsRead) {
  const char* data = std::getenv("WAYMARK_SHARED_DATA");
  if (data == nullptr || !std::filesystem::exists(data)) GTEST_SKIP() << "no real recordings here";
  for (const auto& [name, frames] :
       {std::pair{"tagslam_det_01", 269}, {"tagslam_det_13", 681}, {"tagslam_det_16", 297}}) {
    const std::filesystem::path folder = std::filesystem::path(data) / name;
    const auto calibration = readCalibration(folder / "calib.yml");
    ASSERT_TRUE(calibration.ok()) << calibration.error().message;
    const auto recorded =
        readRecordedDetections(folder / "detections.csv", slam::CameraModel(*calibration));
    ASSERT_TRUE(recorded.ok()) << recorded.error().message;
    EXPECT_EQ(recorded->frames.size(), static_cast<std::size_t>(frames));
    EXPECT_EQ(recorded->outside_lens, 0U);
  }
}

}  // namespace
}  // namespace waymark::io
