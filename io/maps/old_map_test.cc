#include "io/maps/old_map.h"

#include <random>
#include <string>

#include <gtest/gtest.h>

#include "io/text/text_file.h"
#include "slam/testing/synthetic.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

const slam::Calibration kCamera = slam::testing::testCalibration();

class OldMapFile : public ::testing::Test {
 protected:
  OldMapFile() {
    map_.dictionary = use_.dictionary = "4X4_50";
    use_.markers.size_m = 0.1;
    use_.camera = kCamera;
    slam::Transform T_w_m;  // in front of the first camera, facing it
    T_w_m.R = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    T_w_m.p.z() = 2.0;
    map_.addMarker(3, 0.1);
    map_.place(3, T_w_m);
    std::mt19937 rng;
    slam::Keyframe keyframe;
    keyframe.detections = {*slam::testing::observe(slam::CameraModel(kCamera), keyframe.T_w_c, 3,
                                                   T_w_m, 0.1, 0.0, &rng)};
    map_.addKeyframe(keyframe);
  }

  Result<OldMap> read(const std::optional<slam::Calibration>& camera = kCamera) {
    EXPECT_TRUE(writeTextFile(directory_ / "map.json", formatMap(map_, camera)));
    return readOldMap(directory_ / "map.json", use_);
  }
  std::string errorOf(const Result<OldMap>& result) {
    return result ? "no error" : result.error().message;
  }
  void expectError(const Result<OldMap>& result, const std::string& end) {
    EXPECT_TRUE(errorOf(result).ends_with("map.json: " + end)) << errorOf(result);
  }

  const TemporaryDirectory directory_;
  slam::Map map_;
  OldMapUse use_;
};

TEST_F(OldMapFile, ThatFits) {
  const Result<OldMap> old = read();
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_TRUE(old->warnings.empty());
  EXPECT_EQ(old->text, formatMap(old->file.map, old->file.camera));
}

TEST_F(OldMapFile, OfOtherMarkers) {
  use_.markers.size_m = 0.2;
  expectError(read(), "markers: marker 3 has a side of 0.1 m there, but 0.2 m here");
  use_.markers.other_sizes = {{{0, 9}, 0.1}};
  EXPECT_TRUE(read());
  use_.dictionary = "5X5_50";
  expectError(read(), "dictionary: is 4X4_50, but 5X5_50 is looked for");
}

TEST_F(OldMapFile, OfACameraCalibratedAgain) {
  use_.camera.fx += 2.0;
  const Result<OldMap> old = read();
  ASSERT_TRUE(old) << old.error().message;
  ASSERT_EQ(old->warnings.size(), 1U);
  EXPECT_NE(old->warnings[0].find("camera: was calibrated differently, up to 1."),
            std::string::npos)
      << old->warnings[0];
  EXPECT_EQ(old->file.camera->fx, use_.camera.fx);
  const slam::MarkerDetection& detection = old->file.map.keyframes().at(0).detections[0];
  EXPECT_EQ(detection.normalized[0],
            *slam::CameraModel(use_.camera).undistort(detection.pixels[0]));
}

TEST_F(OldMapFile, OfAnotherCamera) {
  use_.camera.fx *= 1.1;
  EXPECT_NE(errorOf(read()).find("camera: is another one, or badly calibrated: up to "),
            std::string::npos);
  use_.localize_only = true;
  ASSERT_TRUE(read());
  EXPECT_EQ(read()->file.camera->fx, kCamera.fx);
  use_.localize_only = false;
  use_.camera = kCamera;
  use_.camera.width = 1280;
  expectError(read(), "camera: has another image size or lens model");
}

// Nobody has given a lens, as nobody had when the map was made: it goes on with its own.
TEST_F(OldMapFile, WithoutACalibration) {
  slam::Calibration learned = kCamera;
  learned.covariance = 1e-2 * slam::IntrinsicMatrix::Identity();
  use_.camera.fx = use_.camera.fy = 0.6 * kCamera.fx;  // a guess
  use_.lens_given = false;
  Result<OldMap> old = read(learned);
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_EQ(old->lens, learned);
  EXPECT_TRUE(old->warnings.empty());
  use_.localize_only = true;
  old = read(learned);
  ASSERT_TRUE(old);
  EXPECT_EQ(old->lens, kCamera) << "perhaps another camera's: nothing is known of it for sure";
  use_.localize_only = false;
  use_.camera.width = 1280;
  expectError(read(learned), "camera: has another image size or lens model");
}

// The calibration was 2 % off, which the map has found out: a start with it is none with another
// camera.
TEST_F(OldMapFile, ThatHasLearnedALens) {
  slam::Calibration learned = kCamera;
  learned.covariance = 1e-2 * slam::IntrinsicMatrix::Identity();
  use_.camera.fx *= 1.02;
  use_.camera.fy *= 1.02;
  EXPECT_NE(errorOf(read()).find("camera: is another one"), std::string::npos) << errorOf(read());
  Result<OldMap> old = read(learned);
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_EQ(old->lens, learned);
  ASSERT_EQ(old->warnings.size(), 1U);
  EXPECT_NE(
      old->warnings[0].find("camera: going on with the lens as the map has learned it, up to "),
      std::string::npos)
      << old->warnings[0];
  use_.camera.covariance = 1e-3 * slam::IntrinsicMatrix::Identity();  // measured, and better
  EXPECT_FALSE(read(learned)) << "another camera";
  use_.camera = kCamera;
  use_.camera.covariance = 1e-3 * slam::IntrinsicMatrix::Identity();
  ASSERT_TRUE(read(learned));
  EXPECT_FALSE(read(learned)->lens) << "what was given is known better";
}

TEST_F(OldMapFile, TakenWithARollingShutter) {
  for (const double readout_s : {0.02, -0.015}) {  // the second one turned upside down
    ASSERT_TRUE(writeTextFile(directory_ / "map.json", formatMap(map_, kCamera, readout_s)));
    Result<OldMap> old = readOldMap(directory_ / "map.json", use_);
    ASSERT_TRUE(old) << old.error().message;
    EXPECT_EQ(old->readout_s, readout_s);
    slam::Options options;
    agreeOnReadout(&*old, &options);
    EXPECT_FALSE(options.shutter.readout_s) << "it is still to be learned";
    EXPECT_EQ(options.shutter.learned_s, readout_s);

    options = {};
    options.shutter.readout_s = 0.0;
    options.mapping = false;
    agreeOnReadout(&*old, &options);
    EXPECT_EQ(old->file.readout_s, readout_s) << "a map to localize in stays as it is";
    options.mapping = true;
    agreeOnReadout(&*old, &options);
    EXPECT_EQ(old->file.readout_s, 0.0);
    EXPECT_EQ(options.shutter.readout_s, 0.0);
  }
}

TEST_F(OldMapFile, OfMarkersOnly) {
  map_.removeKeyframe(0);
  const Result<OldMap> old = read(std::nullopt);
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_EQ(old->file.camera->fx, kCamera.fx);
}

TEST_F(OldMapFile, WithNothingToLocalizeIn) {
  map_.removeKeyframe(0);
  map_.quarantine(3);
  ASSERT_TRUE(read()) << "it can still grow";
  use_.localize_only = true;
  expectError(read(), "markers: none has a pose, so there is nothing to localize in");
}

TEST_F(OldMapFile, ThatWasEdited) {
  std::string text = formatMap(map_, kCamera);
  const std::size_t begin = text.find("\"checksum\"");
  text.erase(begin, text.find('\n', begin) + 1 - begin);
  ASSERT_TRUE(writeTextFile(directory_ / "map.json", text));
  const Result<OldMap> old = readOldMap(directory_ / "map.json", use_);
  ASSERT_TRUE(old) << old.error().message;
  ASSERT_EQ(old->warnings.size(), 1U);
  EXPECT_TRUE(old->warnings[0].ends_with("map.json: has no checksum: taken as it is"));
}

}  // namespace
}  // namespace waymark::io
