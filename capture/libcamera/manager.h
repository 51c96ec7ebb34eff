// libcamera's own beginning and end.
#pragma once

#include <memory>
#include <string>

#include <libcamera/camera.h>
#include <libcamera/camera_manager.h>

#include "base/result.h"

namespace waymark::capture::libcam {

// Has libcamera report errors only: what it says besides is for its developers, who set
// LIBCAMERA_LOG_LEVELS. Changes the environment, so before there is a second thread.
void quietUnlessAsked();

// libcamera allows one manager in a process and aborts at a second: whoever asks while there is one
// shares it. Any thread.
[[nodiscard]] Result<std::shared_ptr<libcamera::CameraManager>> sharedManager();

// The camera with this id or, of a name of digits, this number. The error lists what there is.
[[nodiscard]] Result<std::shared_ptr<libcamera::Camera>> findCamera(
    const libcamera::CameraManager& manager, const std::string& name);

// A camera that nobody else uses, as long as this lives.
class AcquiredCamera {
 public:
  [[nodiscard]] static Result<AcquiredCamera> acquire(std::shared_ptr<libcamera::Camera> camera);
  AcquiredCamera(AcquiredCamera&&) = default;
  AcquiredCamera& operator=(AcquiredCamera&&) = delete;
  ~AcquiredCamera();

  libcamera::Camera* operator->() const { return camera_.get(); }
  [[nodiscard]] const std::shared_ptr<libcamera::Camera>& shared() const { return camera_; }

 private:
  explicit AcquiredCamera(std::shared_ptr<libcamera::Camera> camera) : camera_(std::move(camera)) {}

  std::shared_ptr<libcamera::Camera> camera_;
};

}  // namespace waymark::capture::libcam
