// Frames of a camera that libcamera drives: camera modules with an image processor, and webcams.
// Where Waymark was built without libcamera, opening one is an error that says so.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "capture/camera_options.h"
#include "capture/frame_source.h"

namespace waymark::capture {

// Opens one camera, as often as it comes back, and remembers which it was.
class LibcameraOpener {
 public:
  // `name` is a camera's number, from 0, or its id; both as listLibcameras() has them.
  [[nodiscard]] static Result<LibcameraOpener> create(const std::string& name,
                                                      const CameraOptions& options);

  // Takes the camera for itself, sets format, size, rate and controls, and starts it. Grey planes
  // are shown where they lie; all else is converted. Named controls are libcamera's own
  // ("AnalogueGain"), and are read back from the frames' metadata.
  //
  // libcamera does not say when a camera is unplugged: it falls silent.
  [[nodiscard]] Result<std::unique_ptr<FrameSource>> open();

 private:
  LibcameraOpener(std::string name, CameraOptions options)
      : name_(std::move(name)), options_(std::move(options)) {}

  std::string name_;
  CameraOptions options_;
  std::string known_id_;           // of the camera that was opened; empty before
  std::shared_ptr<void> running_;  // libcamera itself, while there is something open
};

struct LibcameraCamera {
  std::string id;                     // says where it is plugged in
  std::string model;                  // empty when it does not say
  std::vector<std::string> modes;     // "NV12 640x480", a line each
  std::vector<std::string> controls;  // "ExposureTime: [14..1000000]", a line each
};
// In the order of their numbers; empty where Waymark was built without libcamera.
[[nodiscard]] std::vector<LibcameraCamera> listLibcameras();

// What libcamera itself has to say (errors, unless LIBCAMERA_LOG_LEVELS asks for more) goes to
// `sink` while this lives, instead of to stderr: whoever reads that may have stopped, and libcamera
// would wait for it on the frames' way. Where LIBCAMERA_LOG_FILE names a file, it goes there. Make
// it before there are other threads; whatever libcamera has open must end before it.
class LibcameraMessages {
 public:
  // A line without its newline. Any thread, several at once.
  using Sink = std::function<void(std::string_view line)>;

  explicit LibcameraMessages(Sink sink);
  ~LibcameraMessages();
  LibcameraMessages(const LibcameraMessages&) = delete;
  LibcameraMessages& operator=(const LibcameraMessages&) = delete;

 private:
  struct Output;
  std::unique_ptr<Output> output_;  // null: nothing is redirected
};

}  // namespace waymark::capture
