#include "io/calibrations/calibration_file.h"

#include <array>
#include <string>
#include <tuple>

#include <gtest/gtest.h>

#include "io/calibrations/ros_calibration.h"
#include "io/text/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

std::string matrix(const std::string& key, int rows, int cols, const std::string& data) {
  return key + ": !!opencv-matrix\n   rows: " + std::to_string(rows) +
         "\n   cols: " + std::to_string(cols) + "\n   dt: d\n   data: [ " + data + " ]\n";
}

// Of 9 rows; the first entry as given, the others 1.
std::string diagonal(double first) {
  std::string text = std::to_string(first);
  for (int i = 1; i < 81; ++i) text += i % 10 == 0 ? ", 1." : ", 0.";
  return text;
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

TEST(CalibrationFile, FisheyeOfOpenCvsSampleProgram) {
  Yaml yaml;
  yaml.distortion = matrix("distortion_coefficients", 4, 1, "0.01, 0.02, 0.03, 0.04");
  yaml.model = "fisheye_model: 1\n";
  const Result<slam::Calibration> calibration = read(yaml.text());
  ASSERT_TRUE(calibration.ok()) << calibration.error().message;
  EXPECT_EQ(calibration->model, slam::DistortionModel::kEquidistant);
}

// As ROS's camera_calibration writes it.
constexpr const char* kCameraInfo = R"(image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [600.5, 0, 320.25, 0, 610.5,
         240.75, 0, 0, 1]
distortion_model: rational_polynomial
distortion_coefficients:
  rows: 1
  cols: 8
  data: [0.1, 0.2, 0.003, 0.004, 0.5, 0.6, 0.7, 0.8]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [600.5, 0, 320.25, 0, 0, 610.5, 240.75, 0, 0, 0, 1, 0]
)";

TEST(CalibrationFile, ReadsCameraInfoOfRos) {
  const Result<slam::Calibration> c = read(kCameraInfo);
  ASSERT_TRUE(c.ok()) << c.error().message;
  EXPECT_EQ(c->width, 640);
  EXPECT_EQ(c->fy, 610.5);
  EXPECT_EQ(c->cx, 320.25);
  EXPECT_EQ(c->distortion[7], 0.8);
}

TEST(CalibrationFile, ReadsPrintedMessagesOfRos) {
  const char* const ros1 = R"(header:
  seq: 12
  stamp:
    secs: 1600000000
    nsecs: 1
  frame_id: "camera"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [-0.1, 0.2, 0.001, 0.002, 0.0]
K: [600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0]
binning_x: 0
roi:
  x_offset: 0
  do_rectify: False
---
)";
  const Result<slam::Calibration> first = read(ros1);
  ASSERT_TRUE(first.ok()) << first.error().message;
  EXPECT_EQ(first->distortion[0], -0.1);
  const char* const ros2 = R"(height: 480
width: 640
distortion_model: equidistant
d:
- 0.1
- 0.2
- 0.3
- 0.4
k:
- 600.0
- 0.0
- 320.0
- 0.0
- 610.0
- 240.0
- 0.0
- 0.0
- 1.0
binning_x: 2
)";
  const Result<slam::Calibration> binned = read(ros2);
  ASSERT_FALSE(binned.ok());
  EXPECT_NE(binned.error().message.find("binning_x: binned"), std::string::npos);
  std::string text = ros2;
  text.replace(text.find("binning_x: 2"), 12, "binning_x: 1");
  const Result<slam::Calibration> second = read(text);
  ASSERT_TRUE(second.ok()) << second.error().message;
  EXPECT_EQ(second->model, slam::DistortionModel::kEquidistant);
  EXPECT_EQ(second->distortion[3], 0.4);
}

// As Kalibr writes it.
constexpr const char* kCamchain = R"(cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99, 0.002, 0.0003, -0.11]
  - [-0.002, 0.99, 0.014, 0.0004]
  - [-0.0003, -0.014, 0.99, -0.0002]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [457.6, 456.1, 379.9, 255.2]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
)";

TEST(CalibrationFile, ReadsOneCameraOfKalibr) {
  const std::string chain = kCamchain;
  const Result<slam::Calibration> only = read(chain.substr(0, chain.find("cam1:")));
  ASSERT_TRUE(only.ok()) << only.error().message;
  EXPECT_EQ(only->width, 752);
  EXPECT_EQ(only->fx, 458.6);
  EXPECT_EQ(only->cy, 248.4);
  EXPECT_EQ(only->distortion[3], 0.00002);
  EXPECT_EQ(only->distortion[4], 0.0);

  const TemporaryDirectory directory;
  ASSERT_TRUE(writeTextFile(directory / "chain.yaml", chain).ok());
  const Result<slam::Calibration> second = readCalibration(directory / "chain.yaml#cam1");
  ASSERT_TRUE(second.ok()) << second.error().message;
  EXPECT_EQ(second->model, slam::DistortionModel::kEquidistant);
  EXPECT_EQ(second->fx, 457.6);
  const auto complaint = [&](const char* name) {
    const Result<slam::Calibration> read = readCalibration(directory / name);
    return read ? "no complaint" : read.error().message;
  };
  EXPECT_NE(complaint("chain.yaml").find("chain.yaml: has several cameras (cam0, cam1)"),
            std::string::npos);
  EXPECT_NE(complaint("chain.yaml#cam2").find("has no camera 'cam2', but cam0, cam1"),
            std::string::npos);
}

TEST(CalibrationFile, FaultsOfKalibrNameTheirKey) {
  const std::string chain = kCamchain;
  const std::string one = chain.substr(0, chain.find("cam1:"));
  const struct {
    std::string before, after, complaint;
  } cases[] = {
      {"pinhole", "omni", "cam0.camera_model: 'omni' is unknown; known: pinhole"},
      {"radtan", "fov", "cam0.distortion_model: 'fov' is unknown"},
      {"[752, 480]", "[752]", "cam0.resolution: must be a list of 2"},
      {", 248.4]", "]", "cam0.intrinsics: must be a list of 4"},
      {", 0.00002]", "]", "cam0.distortion_coeffs: must be 4 numbers"},
      {"  resolution", "  size", "cam0.resolution: is missing"},
  };
  for (const auto& c : cases) {
    std::string text = one;
    text.replace(text.find(c.before), c.before.size(), c.after);
    const Result<slam::Calibration> calibration = read(text);
    ASSERT_FALSE(calibration.ok()) << c.complaint;
    EXPECT_NE(calibration.error().message.find("calib.yml: " + c.complaint), std::string::npos)
        << calibration.error().message;
  }
}

TEST(CalibrationFile, OtherYamlIsNone) {
  const Result<slam::Calibration> calibration = read("bodies:\n - world: 1\n");
  ASSERT_FALSE(calibration.ok());
  EXPECT_NE(calibration.error().message.find("is no calibration"), std::string::npos);
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
      {&Yaml::size, "image_width: wide\nimage_height: 480\n",
       "image_width: must be a whole number from 1"},
      {&Yaml::size, "image_width: 0\nimage_height: 480\n",
       "image_width: must be a whole number from 1"},
      {&Yaml::size, "image_width: 640.5\nimage_height: 480\n",
       "image_width: must be a whole number from 1"},
      {&Yaml::camera, "", "camera_matrix: is missing"},
      {&Yaml::camera, "camera_matrix: 5\n", "camera_matrix: must be a matrix"},
      {&Yaml::camera, matrix("camera_matrix", 1, 3, "1., 2., 3."), "is 1x3, must be 3x3"},
      {&Yaml::camera, matrix("camera_matrix", 3, 3, "1., 2."),
       "camera_matrix.data: must be 9 numbers"},
      {&Yaml::camera, camera(".nan, 0., 320., 0., 610., 240., 0., 0., 1."),
       "camera_matrix.data[0]: must be a number"},
      {&Yaml::camera, camera("600., 2., 320., 0., 610., 240., 0., 0., 1."), "must have the form"},
      {&Yaml::camera, camera("-6., 0., 320., 0., 610., 240., 0., 0., 1."), "focal lengths"},
      {&Yaml::camera, camera("600., 0., 920., 0., 610., 240., 0., 0., 1."), "principal point"},
      {&Yaml::distortion, "", "distortion_coefficients: is missing"},
      {&Yaml::distortion, distortion(3, "1., 2., 3."), "distortion_coefficients: has 3"},
      {&Yaml::distortion, distortion(12, "0,0,0,0, 0,0,0,0, 1.,0,0,0"), "must be zero"},
      {&Yaml::distortion, distortion(4, "0., .inf, 0., 0."),
       "distortion_coefficients.data[1]: must be a number"},
      {&Yaml::model, "distortion_model: barrel\n", "distortion_model: 'barrel' is unknown"},
      {&Yaml::model, "distortion_model: equidistant\n", "an equidistant lens has 4"},
      {&Yaml::model, matrix("intrinsics_covariance", 2, 2, "1., 0., 0., 1."),
       "intrinsics_covariance: is 2x2, must be 9x9"},
      {&Yaml::model, matrix("intrinsics_covariance", 9, 9, "1., 2."),
       "intrinsics_covariance.data: must be 81 numbers"},
      {&Yaml::model, matrix("intrinsics_covariance", 9, 9, diagonal(-1.0)),
       "covariance of the intrinsics"},
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

TEST(CalibrationFile, WhatIsNoYamlIsSaidSo) {
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
  c.covariance = slam::IntrinsicMatrix::Zero();  // the ninth means nothing
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) (*c.covariance)(i, j) = (i == j ? 1.0 : 0.1) / (3.0 + i + j);
  }
  ASSERT_TRUE(writeCalibration(directory / "c.yml", c).ok());
  const Result<slam::Calibration> back = readCalibration(directory / "c.yml");
  ASSERT_TRUE(back.ok()) << back.error().message;
  EXPECT_EQ(*back, c);
}

TEST(CalibrationFile, CameraInfoReadsBackBitForBit) {
  slam::Calibration c{
      .width = 640, .height = 480, .fx = 601.0 / 3.0, .fy = 610.0, .cx = 320.7, .cy = 240.0};
  for (const auto& [model, distortion, name] :
       {std::tuple{slam::DistortionModel::kRational,
                   std::array{-0.1, 0.2, 1e-4, -1e-3, 1.0 / 3.0, 0.0, 0.0, 0.0}, "plumb_bob"},
        {slam::DistortionModel::kRational,
         {-0.1, 0.2, 1e-4, -1e-3, 1.0, 0.1, 0.2, 1e-17},
         "rational_polynomial"},
        {slam::DistortionModel::kEquidistant,
         {0.1, 0.2, 0.3, 0.4, 0.0, 0.0, 0.0, 0.0},
         "equidistant"}}) {
    c.model = model;
    c.distortion = distortion;
    const std::string text = formatCameraInfo(c, "camera");
    EXPECT_NE(text.find(std::string("distortion_model: ") + name + "\n"), std::string::npos);
    EXPECT_NE(text.find("camera_name: camera\n"), std::string::npos);
    const Result<slam::Calibration> back = read(text);
    ASSERT_TRUE(back.ok()) << back.error().message;
    EXPECT_EQ(back->fx, c.fx);
    EXPECT_EQ(back->fy, c.fy);
    EXPECT_EQ(back->model, c.model);
    EXPECT_EQ(back->distortion, c.distortion);
  }
}

}  // namespace
}  // namespace waymark::io
