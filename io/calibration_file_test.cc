#include "io/calibration_file.h"

#include <string>

#include <gtest/gtest.h>

#include "io/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

std::string matrix(const std::string& key, int rows, int cols, const std::string& data) {
  return key + ": !!opencv-matrix\n   rows: " + std::to_string(rows) +
         "\n   cols: " + std::to_string(cols) + "\n   dt: d\n   data: [ " + data + " ]\n";
}

struct Yaml {
  std::string size = "image_width: 640\nimage_height: 480\n";
  std::string camera = matrix("camera_matrix", 3, 3, "600., 0., 320., 0., 610., 240., 0., 0., 1.");
  std::string distortion = matrix("distortion_coefficients", 1, 5, "-0.4, 0.2, 1e-4, -1e-3, -0.1");
  std::string model;
  [[nodiscard]] std::string text() const {
    return "%YAML:1.0\n---\n" + size + camera + distortion + model;
  }
};

Result<slam::Calibration> read(const std::string& text) {
  const TemporaryDirectory directory;
  EXPECT_TRUE(writeTextFile(directory / "calib.yml", text).ok());
  return readCalibration(directory / "calib.yml");
}

TEST(CalibrationFile, ReadsWhatOpenCvWrites) {
  const Result<slam::Calibration> calibration = read(Yaml{}.text());
  ASSERT_TRUE(calibration.ok()) << calibration.error().message;
  EXPECT_EQ(calibration->width, 640);
  EXPECT_EQ(calibration->height, 480);
  EXPECT_EQ(calibration->fx, 600.0);
  EXPECT_EQ(calibration->fy, 610.0);
  EXPECT_EQ(calibration->cx, 320.0);
  EXPECT_EQ(calibration->cy, 240.0);
  EXPECT_EQ(calibration->model, slam::DistortionModel::kRational);
  EXPECT_EQ(calibration->distortion[1], 0.2);
  EXPECT_EQ(calibration->distortion[4], -0.1);
  EXPECT_EQ(calibration->distortion[5], 0.0);
}

TEST(CalibrationFile, TakesEveryNumberOfCoefficientsThatMeansSomething) {
  for (const auto& [count, data] : {std::pair{4, "1e-3, 0, 0, 0"},
                                    {8, "1e-3, 0, 0, 0, 0, 1e-4, 0, 0"},
                                    {12, "1e-3, 0, 0, 0, 0, 1e-4, 0, 0, 0, 0, 0, 0"}}) {
    Yaml yaml;
    yaml.distortion = matrix("distortion_coefficients", count, 1, data);
    const Result<slam::Calibration> calibration = read(yaml.text());
    ASSERT_TRUE(calibration.ok()) << calibration.error().message;
    EXPECT_EQ(calibration->distortion[0], 1e-3);
  }
}

TEST(CalibrationFile, ReadsFisheye) {
  Yaml yaml;
  yaml.distortion = matrix("distortion_coefficients", 1, 4, "0.01, 0.02, 0.03, 0.04");
  yaml.model = "distortion_model: fisheye_equidistant\n";
  const Result<slam::Calibration> calibration = read(yaml.text());
  ASSERT_TRUE(calibration.ok()) << calibration.error().message;
  EXPECT_EQ(calibration->model, slam::DistortionModel::kEquidistant);
  EXPECT_EQ(calibration->distortion[3], 0.04);
}

TEST(CalibrationFile, EveryFaultNamesItsKey) {
  struct Case {
    std::string Yaml::*part;
    std::string text;
    std::string complaint;
  };
  const auto camera = [](const char* data) { return matrix("camera_matrix", 3, 3, data); };
  const auto distortion = [](int n, const char* data) {
    return matrix("distortion_coefficients", 1, n, data);
  };
  const Case cases[] = {
      {&Yaml::size, "image_height: 480\n", "image_width: is missing"},
      {&Yaml::size, "image_width: wide\nimage_height: 480\n", "image_width: must be a positive"},
      {&Yaml::size, "image_width: 0\nimage_height: 480\n", "image_width: must be a positive"},
      {&Yaml::size, "image_width: 640.5\nimage_height: 480\n", "image_width: must be a positive"},
      {&Yaml::camera, "", "camera_matrix: is missing"},
      {&Yaml::camera, "camera_matrix: 5\n", "camera_matrix: must be a matrix"},
      {&Yaml::camera, matrix("camera_matrix", 1, 3, "1., 2., 3."), "is 1x3, must be 3x3"},
      {&Yaml::camera, matrix("camera_matrix", 3, 3, "1., 2."), "camera_matrix: must be a matrix"},
      {&Yaml::camera, camera(".nan, 0., 320., 0., 610., 240., 0., 0., 1."), "not finite"},
      {&Yaml::camera, camera("600., 2., 320., 0., 610., 240., 0., 0., 1."), "must have the form"},
      {&Yaml::camera, camera("-6., 0., 320., 0., 610., 240., 0., 0., 1."), "focal lengths"},
      {&Yaml::camera, camera("600., 0., 920., 0., 610., 240., 0., 0., 1."), "principal point"},
      {&Yaml::distortion, "", "distortion_coefficients: is missing"},
      {&Yaml::distortion, distortion(3, "1., 2., 3."), "distortion_coefficients: is 1x3"},
      {&Yaml::distortion, distortion(12, "0,0,0,0, 0,0,0,0, 1.,0,0,0"), "must be zero"},
      {&Yaml::distortion, distortion(4, "0., .inf, 0., 0."), "not finite"},
      {&Yaml::model, "distortion_model: barrel\n", "distortion_model: 'barrel' is unknown"},
      {&Yaml::model, "distortion_model: equidistant\n", "a fisheye lens has 4"},
  };
  for (const Case& c : cases) {
    Yaml yaml;
    yaml.*c.part = c.text;
    const Result<slam::Calibration> calibration = read(yaml.text());
    ASSERT_FALSE(calibration.ok()) << c.complaint;
    EXPECT_NE(calibration.error().message.find("calib.yml: "), std::string::npos);
    EXPECT_NE(calibration.error().message.find(c.complaint), std::string::npos)
        << calibration.error().message;
  }
}

TEST(CalibrationFile, WhatIsNoYamlIsSaidSoAndOpenCvKeepsQuiet) {
  ::testing::internal::CaptureStderr();
  for (const char* text : {"", "hello", "{\"a\": 1}", "%YAML:1.0\n---\na: [1, 2\n",
                           "%YAML:1.0\n---\n : : {{\n", "%YAML:1.0\n---\n- 1\n- 2\n"}) {
    const Result<slam::Calibration> calibration = read(text);
    ASSERT_FALSE(calibration.ok()) << text;
    EXPECT_EQ(calibration.error().message.find('\n'), std::string::npos);
  }
  EXPECT_FALSE(readCalibration("/nonexistent/calib.yml").ok());
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

TEST(CalibrationFile, WrittenFilesReadBackBitForBit) {
  const TemporaryDirectory directory;
  slam::Calibration c{
      .width = 640, .height = 480, .fx = 601.0 / 3.0, .fy = 610.1, .cx = 320.7, .cy = 240.0};
  c.distortion = {-1.0 / 3.0, 0.2, 1e-4, -1e-3, 0.1, 0.0, 0.0, 0.0};
  for (const double k6 : {0.0, 1e-17}) {
    c.distortion[7] = k6;
    ASSERT_TRUE(writeCalibration(directory / "c.yml", c).ok());
    const Result<slam::Calibration> back = readCalibration(directory / "c.yml");
    ASSERT_TRUE(back.ok()) << back.error().message;
    EXPECT_EQ(back->fx, c.fx);
    EXPECT_EQ(back->cy, c.cy);
    EXPECT_EQ(back->distortion, c.distortion);
  }
  c.model = slam::DistortionModel::kEquidistant;
  c.distortion = {0.1, 0.2, 0.3, 0.4};
  ASSERT_TRUE(writeCalibration(directory / "c.yml", c).ok());
  const Result<slam::Calibration> back = readCalibration(directory / "c.yml");
  ASSERT_TRUE(back.ok()) << back.error().message;
  EXPECT_EQ(back->model, c.model);
  EXPECT_EQ(back->distortion, c.distortion);
}

}  // namespace
}  // namespace waymark::io
