// The differences between libcamera's versions, from Debian 12's 0.0.3 to 0.7; nowhere else.
#pragma once

#include <libcamera/camera.h>
#include <libcamera/version.h>

#define WAYMARK_LIBCAMERA_AT_LEAST(major, minor) \
  (LIBCAMERA_VERSION_MAJOR > (major) ||          \
   (LIBCAMERA_VERSION_MAJOR == (major) && LIBCAMERA_VERSION_MINOR >= (minor)))

#if WAYMARK_LIBCAMERA_AT_LEAST(0, 2)
#include <libcamera/orientation.h>
#endif

namespace waymark::capture::libcam {

// Pictures as the camera is mounted, neither turned nor mirrored: what a calibration is made for.
inline void keepUpright(libcamera::CameraConfiguration* configuration) {
#if WAYMARK_LIBCAMERA_AT_LEAST(0, 2)
  configuration->orientation = libcamera::Orientation::Rotate0;
#else
  configuration->transform = libcamera::Transform::Identity;
#endif
}

}  // namespace waymark::capture::libcam
