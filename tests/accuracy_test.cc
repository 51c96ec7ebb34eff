// Detection and SLAM against exact truth (simulated frames) and on real recordings.
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <ostream>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <opencv2/aruco.hpp>
#include <opencv2/core.hpp>

#include "capture/open_source.h"
#include "io/calibrations/calibration_file.h"
#include "simulator/projected_marker.h"
#include "simulator/simulated_source.h"
#include "slam/geometry/align_points.h"
#include "slam/slam.h"

namespace waymark {
namespace {

namespace fs = std::filesystem;
using slam::CameraModel;
using slam::MarkerDetection;
using slam::Transform;

// Calls `use(frame)` for every frame of a recording or simulation.
template <typename Use>
void forEachFrame(capture::FrameSource& source, const Use& use) {
  for (;;) {
    capture::ReadResult result = source.read(std::chrono::milliseconds(0));
    if (std::holds_alternative<Error>(result)) FAIL() << std::get<Error>(result).message;
    if (!std::holds_alternative<capture::FramePtr>(result)) return;
    use(*std::get<capture::FramePtr>(result));
  }
}

slam::FrameTime timeOf(const capture::Frame& frame) {
  return {frame.stamp().sequence, frame.stamp().monotonic_ns};
}

// --- Corners -----------------------------------------------------------------------------------

struct CornerErrors {
  Eigen::Vector2d bias = Eigen::Vector2d::Zero();  // pixels
  double outward = 0.0;                            // bias away from the marker's middle, pixels
  double rms = 0.0;                                // of a coordinate, pixels
  double consistency = 0.0;  // mean of e^T C^-1 e over 2: 1 when the covariance is exact
  int count = 0;
};

// Corners of markers with sides of at least 20 pixels, against the truth.
CornerErrors cornerErrors(const simulator::Options& options) {
  auto source = simulator::openSimulation(options);
  EXPECT_TRUE(source.ok());
  const CameraModel camera((*source)->camera());
  slam::MarkerDetector detector(camera, *slam::Dictionary::byName(options.dictionary));
  std::map<int, simulator::Marker> truth;
  for (const simulator::Marker& marker : (*source)->markers()) truth.emplace(marker.id, marker);

  CornerErrors sum;
  forEachFrame(**source, [&](const capture::Frame& frame) {
    const Transform T_w_c = (*source)->poseAt(static_cast<std::int64_t>(frame.stamp().sequence));
    for (const MarkerDetection& seen : detector.detect(frame.image())) {
      ASSERT_TRUE(truth.contains(seen.id)) << "false id " << seen.id;
      const auto projected = simulator::projectMarker(camera, T_w_c, truth.at(seen.id));
      ASSERT_TRUE(projected) << "marker " << seen.id << " is behind the camera";
      const simulator::ImageCorners& expected = *projected;
      const Eigen::Vector2d middle = 0.25 * (expected[0] + expected[1] + expected[2] + expected[3]);
      constexpr double kSmallest = 20.0;
      if (simulator::shortestSide(expected) < kSmallest) continue;
      for (std::size_t k = 0; k < 4; ++k) {
        const Eigen::Vector2d error = seen.pixels[k] - expected[k];
        Eigen::Matrix2d J;
        (void)camera.distort(seen.normalized[k], &J);
        const Eigen::Matrix2d covariance = J * seen.covariance[k] * J.transpose();
        sum.bias += error;
        sum.outward += error.dot((expected[k] - middle).normalized());
        sum.rms += 0.5 * error.squaredNorm();
        sum.consistency += 0.5 * error.dot(covariance.inverse() * error);
        ++sum.count;
      }
    }
  });
  sum.bias /= sum.count;
  sum.outward /= sum.count;
  sum.rms = std::sqrt(sum.rms / sum.count);
  sum.consistency /= sum.count;
  return sum;
}

class CornerAccuracy : public ::testing::TestWithParam<const char*> {};

TEST_P(CornerAccuracy, RefinementIsUnbiasedAndItsCovarianceHonest) {
  simulator::Options options;
  options.scene = GetParam();
  options.seed = 5;
  options.rate_hz = 5.0;  // the whole way round, few frames
  options.duration_s = 12.0;
  const CornerErrors errors = cornerErrors(options);
  ASSERT_GT(errors.count, 500);
  EXPECT_LT(errors.rms, 0.15);
  EXPECT_LT(errors.bias.cwiseAbs().maxCoeff(), 0.03);
  EXPECT_LT(std::abs(errors.outward), 0.03);
  EXPECT_GT(errors.consistency, 0.2);
  EXPECT_LT(errors.consistency, 1.5);
  // scripts/evaluate puts these into docs/results.md.
  RecordProperty("scene", GetParam());
  RecordProperty("corners", std::to_string(errors.count));
  RecordProperty("rms_px", std::to_string(errors.rms));
  RecordProperty("bias_x_px", std::to_string(errors.bias.x()));
  RecordProperty("bias_y_px", std::to_string(errors.bias.y()));
  RecordProperty("bias_outward_px", std::to_string(errors.outward));
  RecordProperty("consistency", std::to_string(errors.consistency));
}

INSTANTIATE_TEST_SUITE_P(Scenes, CornerAccuracy, ::testing::Values("walls", "ceiling", "spin"));

// Motion blur is symmetric about mid-exposure, so it may cost precision but must not bias. The
// scene at its own speed: up to 40 degrees a second, some 3 pixels during the exposure.
TEST(CornerAccuracyInMotion, BlurDoesNotBias) {
  simulator::Options options;
  options.scene = "walls";
  options.rate_hz = 2.0;
  options.exposure_s = 0.008;
  const CornerErrors errors = cornerErrors(options);
  ASSERT_GT(errors.count, 300);
  EXPECT_LT(errors.rms, 0.15);
  EXPECT_LT(std::abs(errors.outward), 0.03);
}

// --- The whole loop ----------------------------------------------------------------------------

class SceneAccuracy : public ::testing::TestWithParam<const char*> {};

// A short stretch of the paper's scenes; docs/results.md has the full ones.
TEST_P(SceneAccuracy, EveryFrameIsLocalizedToMillimetres) {
  simulator::Options options;
  options.scene = GetParam();
  options.seed = 4;
  options.duration_s = 5.0;
  auto source = simulator::openSimulation(options);
  ASSERT_TRUE(source.ok());
  slam::Options slam_options;
  slam_options.markers.size_m = (*source)->markers().front().size_m;
  slam::Slam slam(CameraModel((*source)->camera()), *slam::Dictionary::byName(options.dictionary),
                  slam_options);

  std::vector<Eigen::Vector3d> estimate;
  std::vector<Eigen::Vector3d> truth;
  int lost = 0;
  forEachFrame(**source, [&](const capture::Frame& frame) {
    const slam::FrameResult result = slam.process({.time = timeOf(frame), .image = frame.image()});
    if (!result.pose) {
      lost += slam.map().empty() ? 0 : 1;
      return;
    }
    estimate.push_back(result.pose->T_w_c.p);
    truth.push_back((*source)->poseAt(static_cast<std::int64_t>(frame.stamp().sequence)).p);
  });
  EXPECT_EQ(lost, 0);
  ASSERT_GT(estimate.size(), 250U);
  const Transform T = slam::alignPoints(estimate, truth);
  double ate = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    ate += (T * estimate[i] - truth[i]).norm();
  }
  ate /= static_cast<double>(truth.size());
  EXPECT_LT(ate, 0.003) << "metres, causal";
}

INSTANTIATE_TEST_SUITE_P(Scenes, SceneAccuracy, ::testing::Values("walls", "ceiling"));

// --- Real recordings ---------------------------------------------------------------------------

struct Recording {
  const char* folder;
  const char* source;
  const char* dictionary;
  double marker_size_m;
  int opencv_dictionary;
};

// For the test's name.
std::ostream& operator<<(std::ostream& out, const Recording& recording) {
  return out << recording.folder;
}

class RealRecording : public ::testing::TestWithParam<Recording> {};

// At least 97 % of the frames in which OpenCV's detector finds a marker get a pose.
TEST_P(RealRecording, IsLocalized) {
  const Recording& recording = GetParam();
  const char* data = std::getenv("WAYMARK_SHARED_DATA");
  const fs::path folder = fs::path(data != nullptr ? data : "") / recording.folder;
  if (!fs::exists(folder)) GTEST_SKIP() << "no recordings at " << folder;
  const auto calibration = io::readCalibration(folder / "calib.yml");
  ASSERT_TRUE(calibration.ok());
  auto source = capture::openSource((folder / recording.source).string(), {});
  ASSERT_TRUE(source.ok());
  slam::Options options;
  options.markers.size_m = recording.marker_size_m;
  slam::Slam slam(CameraModel(*calibration), *slam::Dictionary::byName(recording.dictionary),
                  options);
  const auto dictionary = cv::aruco::getPredefinedDictionary(recording.opencv_dictionary);
  int with_marker = 0;
  int localized = 0;
  forEachFrame(**source, [&](const capture::Frame& frame) {
    const ImageView image = frame.image();
    const cv::Mat grey(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.data),
                       static_cast<std::size_t>(image.stride));
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(grey, dictionary, corners, ids);
    const slam::FrameResult result = slam.process({.time = timeOf(frame), .image = image});
    if (ids.empty()) return;
    ++with_marker;
    localized += result.pose ? 1 : 0;
  });
  ASSERT_GT(with_marker, 0);
  EXPECT_GE(localized, 0.97 * with_marker) << "of " << with_marker;
}

INSTANTIATE_TEST_SUITE_P(
    Recordings, RealRecording,
    ::testing::Values(Recording{"aruco_chess18", "frames.avi", "ARUCO_ORIGINAL", 0.034,
                                cv::aruco::DICT_ARUCO_ORIGINAL},
                      Recording{"aruco_single6", "frames.avi", "ARUCO_ORIGINAL", 0.05,
                                cv::aruco::DICT_ARUCO_ORIGINAL},
                      Recording{"gridboard20_6x6_photos", "frames", "6X6_1000", 0.0375,
                                cv::aruco::DICT_6X6_1000}),
    [](const auto& param_info) { return std::string(param_info.param.folder); });

}  // namespace
}  // namespace waymark
