// Where `waymark run` gets what is found in earlier frames, as the daemon gets it from its thread.
#pragma once

#include "slam/frame.h"
#include "slam/slam.h"

namespace waymark::tools {

class LateResults {
 public:
  LateResults() = default;
  LateResults(const LateResults&) = delete;
  LateResults& operator=(const LateResults&) = delete;
  virtual ~LateResults() = default;

  // Before a frame: its input, with what is due. Valid until look().
  [[nodiscard]] virtual slam::FrameInput prepare(slam::FrameInput frame) = 0;
  // After it, of the same input.
  virtual void look(const slam::FrameInput& frame, const slam::FrameResult& result,
                    const slam::Slam& slam) = 0;
};

}  // namespace waymark::tools
