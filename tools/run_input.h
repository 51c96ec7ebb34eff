// What `waymark run` runs over: frames of a recording, or recorded detections.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "base/image_view.h"
#include "base/result.h"
#include "slam/geometry/calibration_fit.h"
#include "slam/slam.h"
#include "tools/natural/late_results.h"
#include "tools/stage_timer.h"

namespace waymark::tools {

struct RunInputOptions {
  std::string source;       // as typed
  std::string calibration;  // for messages: the file it came from
  slam::CalibrationFit calibration_fit = slam::CalibrationFit::kExact;
  std::optional<double> fps;  // Hz
  bool realtime = false;
  std::optional<double> fov_deg;  // of the image's width, without a calibration
};

// One frame after the other through the SLAM.
class RunInput {
 public:
  struct Step {
    std::int64_t time_ns = 0;  // of the recording; in real time since its first frame
    slam::FrameResult result;
  };

  RunInput() = default;
  RunInput(const RunInput&) = delete;
  RunInput& operator=(const RunInput&) = delete;
  virtual ~RunInput() = default;

  // Processes the next frame. Empty at the end of the recording. `late`: null where nobody looks
  // for natural markers; that is not the SLAM's time.
  [[nodiscard]] virtual Result<std::optional<Step>> step(slam::Slam& slam, StageTimer& timer,
                                                         LateResults* late) = 0;
  // Sees every image after its frame, in no time of the SLAM's. Before the first step().
  using ImageObserver = std::function<void(const ImageView&)>;
  virtual void setImageObserver(const ImageObserver& /*observer*/) {}
  // Natural markers can be looked for.
  [[nodiscard]] virtual bool hasImages() const { return true; }

  [[nodiscard]] virtual const std::string& description() const = 0;
  [[nodiscard]] virtual std::optional<std::int64_t> frameCount() const = 0;
  // Images of unknown times: one need not look like the one before.
  [[nodiscard]] virtual bool unorderedImages() const { return false; }
  // Frames come as a camera takes them, until somebody stops it.
  [[nodiscard]] virtual bool endless() const { return false; }
  // What of a recording could not be read; empty when all could.
  [[nodiscard]] virtual std::string damage() const { return {}; }
  // Frames that were never processed because their time had passed.
  [[nodiscard]] virtual std::uint64_t droppedLate() const = 0;
};

struct OpenedInput {
  std::unique_ptr<RunInput> input;
  slam::FittedCalibration fitted;  // the calibration for these frames
  bool lens_given = true;          // else it is a guess
};

// A source that ends in .csv holds recorded detections; anything else is opened as frames, whose
// size must be the calibration's, or fit it as the options say. Without a calibration the camera is
// a guess (slam::guessedCamera); recorded detections do not say the size of their images: it is the
// smallest usual one that has room for all of them.
[[nodiscard]] Result<OpenedInput> openRunInput(const RunInputOptions& options,
                                               const std::optional<slam::Calibration>& calibration);

}  // namespace waymark::tools
