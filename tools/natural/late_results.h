// Where `waymark run` gets what is found in earlier frames, as the daemon gets it from its thread;
// or in photographs, each of which is looked at before it goes to the SLAM.
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

  // Before a frame: its input, with what is due, or was found in it. Valid until the next one.
  [[nodiscard]] virtual slam::FrameInput prepare(slam::FrameInput frame,
                                                 const slam::Slam& slam) = 0;
  // After it, of the same input.
  virtual void look(const slam::FrameInput& frame, const slam::FrameResult& result,
                    const slam::Slam& slam) = 0;
};

}  // namespace waymark::tools
