// What a camera sees on its way through a simulated room, as frames for the test camera: rendered
// once, shown forwards and backwards without end. Tests only.
#pragma once

#include <cstdint>
#include <vector>

#include "slam/geometry/camera_model.h"
#include "tests/vm/uvc/uvc_camera.h"

namespace waymark::testing {

class SceneFilm {
 public:
  // 640x480, of the scene "walls" with its ARUCO_MIP_36h12 markers of 0.165 m: the first third of a
  // metre of its way. From one picture to the next it is some two centimetres.
  SceneFilm();

  // One for all tests of a program: to render it takes the guest half a minute.
  [[nodiscard]] static const SceneFilm& shared();

  [[nodiscard]] const slam::Calibration& calibration() const { return calibration_; }

  // Which picture frame `index` shows, and after how many frames the film begins again.
  [[nodiscard]] int pictureOf(std::uint64_t index) const;
  [[nodiscard]] int period() const { return 2 * pictures() - 2; }
  [[nodiscard]] int pictures() const { return static_cast<int>(grey_.size()); }

  // A picture as the mode wants it: MJPEG in colour, as of any webcam.
  // Precondition: the mode is of the film's size.
  [[nodiscard]] Bytes encoded(const StreamMode& mode, int picture) const;
  // What a decoder makes of it.
  [[nodiscard]] Bytes grey(const StreamMode& mode, int picture) const;

  // A camera that shows the film, which must outlive it.
  [[nodiscard]] CameraOptions camera() const;

 private:
  slam::Calibration calibration_;
  std::vector<Bytes> grey_;
  std::vector<Bytes> jpeg_;
};

}  // namespace waymark::testing
