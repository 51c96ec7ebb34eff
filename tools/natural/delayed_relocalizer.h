// Natural markers in a recording: frames are looked at one after the other, as by the daemon's
// thread, and what is found is given to the SLAM a fixed number of frames later, so that a run is
// the same each time.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slam/frame.h"
#include "slam/natural/pictures/picture_relocalizer.h"
#include "slam/slam.h"
#include "tools/natural/late_results.h"

namespace waymark::tools {

class DelayedRelocalizer final : public LateResults {
 public:
  // delay_frames: as many as come while the daemon's thread looks at one image: 150 ms at 30 a
  // second. At least 1.
  explicit DelayedRelocalizer(std::vector<slam::PosedNaturalMarker> pictures, int delay_frames = 5)
      : relocalizer_(std::move(pictures)), delay_frames_(delay_frames) {}

  [[nodiscard]] slam::FrameInput prepare(slam::FrameInput frame, const slam::Slam& slam) override;
  void look(const slam::FrameInput& frame, const slam::FrameResult& result,
            const slam::Slam& slam) override;

  [[nodiscard]] const slam::RelocalizationCounts& counts() const { return relocalizer_.counts(); }

 private:
  slam::PictureRelocalizer relocalizer_;
  int delay_frames_;
  int due_in_ = 0;  // frames, until what was found is delivered; 0: nothing is looked at
  std::vector<slam::LateResult> found_;
  std::vector<slam::LateResult> delivered_;
};

}  // namespace waymark::tools
