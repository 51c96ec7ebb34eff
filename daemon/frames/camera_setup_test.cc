#include "daemon/frames/camera_setup.h"

#include <fstream>
#include <string>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include "io/calibrations/calibration_file.h"
#include "tests/temporary_directory.h"

namespace waymark::daemon {
namespace {

constexpr int kWidth = 64;
constexpr int kHeight = 48;

// A recording has a buffer for each frame that may wait, for one at the SLAM and for one that has
// just been read: else it could not read on while the queue is full, and the newest frames would
// come too late instead of the oldest ones giving way.
TEST(CameraSetup, ARecordingReadsOnWhileTheQueueIsFull) {
  const testing::TemporaryDirectory directory;
  const std::filesystem::path images = directory / "images";
  std::filesystem::create_directory(images);
  for (int i = 100; i < 140; ++i) {
    std::ofstream(images / (std::to_string(i) + ".pgm"), std::ios::binary)
        << "P5 " << kWidth << " " << kHeight << " 255\n"
        << std::string(kWidth * kHeight, 'g');
  }
  const slam::Calibration calibration{
      .width = kWidth, .height = kHeight, .fx = 60.0, .fy = 60.0, .cx = 31.5, .cy = 23.5};
  std::ofstream(directory / "calib.yml") << io::formatCalibration(calibration);

  Configuration configuration;
  configuration.camera.source = images.string();
  configuration.camera.calibration = directory / "calib.yml";
  configuration.camera.rate_hz = 50.0;
  configuration.queue.depth = 7;
  Result<CameraSetup> setup = prepareCamera(configuration);
  ASSERT_TRUE(setup) << setup.error().message;
  const auto source = setup->opener.open();
  ASSERT_TRUE(source) << source.error().message;
  std::vector<capture::FramePtr> held;
  constexpr int kReads = 200;
  for (int i = 0; i < kReads && held.size() < 9; ++i) {
    capture::ReadResult result = (*source)->read(std::chrono::milliseconds(20));
    if (auto* frame = std::get_if<capture::FramePtr>(&result)) held.push_back(std::move(*frame));
  }
  EXPECT_EQ(held.size(), 9U);
}

}  // namespace
}  // namespace waymark::daemon
