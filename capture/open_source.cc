#include "capture/open_source.h"

#include <cmath>
#include <filesystem>
#include <utility>

#include "capture/image_directory_source.h"
#include "capture/paced_source.h"
#include "capture/video_source.h"

namespace waymark::capture {

Result<std::unique_ptr<FrameSource>> openSource(const std::string& spec,
                                                const SourceOptions& options) {
  if (options.fps && !(*options.fps > 0.0 && std::isfinite(*options.fps))) {
    return Error{spec + ": the frame rate must be positive"};
  }
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(spec, error);
  if (!std::filesystem::exists(status)) {
    const bool has_scheme = spec.find(':') != std::string::npos;
    return Error{spec + (has_scheme ? ": unknown kind of source" : ": no such file or directory") +
                 "; a source is a video file or a directory of images"};
  }
  Result<std::unique_ptr<FrameSource>> opened = std::filesystem::is_directory(status)
                                                    ? openImageDirectory(spec, options.fps)
                                                    : openVideo(spec, options.fps);
  if (!opened || !options.realtime) return opened;
  return playInRealTime(std::move(opened).value(), options.fps);
}

}  // namespace waymark::capture
