// From what a user typed to a frame source.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "base/result.h"
#include "capture/frame_source.h"

namespace waymark::capture {

struct SourceOptions {
  std::optional<double> fps;  // Hz; overrides the recording's own times
  bool realtime = false;      // play as if a camera were taking it now
};

// `spec` is a video file or a directory of images. Anything else is an error that says so.
[[nodiscard]] Result<std::unique_ptr<FrameSource>> openSource(const std::string& spec,
                                                              const SourceOptions& options);

}  // namespace waymark::capture
