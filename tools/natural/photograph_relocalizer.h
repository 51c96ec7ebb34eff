// Natural markers in photographs in no order: each is looked at before it goes to the SLAM, which
// has the answer with the photograph itself.
#pragma once

#include <utility>
#include <vector>

#include "slam/frame.h"
#include "slam/natural/pictures/picture_relocalizer.h"
#include "slam/slam.h"
#include "tools/natural/late_results.h"

namespace waymark::tools {

class PhotographRelocalizer final : public LateResults {
 public:
  explicit PhotographRelocalizer(std::vector<slam::PosedNaturalMarker> pictures)
      : relocalizer_(std::move(pictures)) {}

  // Among all pictures: nobody knows where the next one is taken.
  [[nodiscard]] slam::FrameInput prepare(slam::FrameInput frame, const slam::Slam& slam) override {
    if (!frame.image) return frame;
    frame.found = relocalizer_.locate(
        {.time = frame.time, .generation = 0, .image = *frame.image, .last = {}}, slam.camera());
    return frame;
  }
  void look(const slam::FrameInput& /*frame*/, const slam::FrameResult& /*result*/,
            const slam::Slam& /*slam*/) override {}

 private:
  slam::PictureRelocalizer relocalizer_;
};

}  // namespace waymark::tools
