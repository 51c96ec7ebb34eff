// Recorded detections: detections.csv, and behind a line of dashes the frames.csv to it. What is
// accepted is written and read again, and is something that the SLAM can look at.
#include <algorithm>
#include <optional>

#include "io/recorded_detections.h"
#include "slam/slam.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

namespace {

slam::CameraModel camera() {
  slam::Calibration c{
      .width = 640, .height = 480, .fx = 520.0, .fy = 521.0, .cx = 318.0, .cy = 242.0};
  c.distortion = {-0.2, 0.05, 3e-4, -2e-4, 0.0};
  return slam::CameraModel(c);
}

void run(const io::RecordedDetections& recorded) {
  static const slam::Dictionary dictionary = *slam::Dictionary::byName("APRILTAG_36h11");
  slam::Options options;
  options.markers.size_m = 0.2;
  slam::Slam slam(camera(), dictionary, options);
  std::uint64_t sequence = 0;
  for (const io::RecordedFrame& frame : recorded.frames) {
    (void)slam.process({.time = {sequence++, frame.time_ns}, .detections = frame.detections});
  }
  slam.finish();
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string text = fuzz::textOf(data, size);
  std::optional<std::string> times;
  constexpr const char* kDashes = "\n---\n";
  if (const std::size_t at = text.find(kDashes); at != std::string::npos) {
    times = text.substr(at + 5);
    text.resize(at);
  }
  const slam::CameraModel lens = camera();
  const auto recorded = io::parseRecordedDetections(text, times, "detections.csv", lens);
  if (!recorded) {
    fuzz::requireOneLine(recorded.error());
    return 0;
  }
  const std::string written = io::formatRecordedDetections(recorded->frames, lens);
  const auto again = io::parseRecordedDetections(written, io::formatFrameTimes(recorded->frames),
                                                 "again.csv", lens);
  fuzz::require(again.ok(), "what was written is read: " +
                                (again ? std::string() : again.error().message) + "\n" + written);
  fuzz::require(again->frames.size() == recorded->frames.size(), "all frames are there again");
  run(*recorded);
  return 0;
}
