// What stands in for libcamera_source.cc where there is no libcamera to build with.
#include "capture/libcamera/libcamera_source.h"

namespace waymark::capture {

Result<LibcameraOpener> LibcameraOpener::create(const std::string& name, const CameraOptions&) {
  return Error{"libcamera:" + name + ": Waymark was built without libcamera"};
}

Result<std::unique_ptr<FrameSource>> LibcameraOpener::open() {
  return Error{"libcamera:" + name_ + ": Waymark was built without libcamera"};
}

std::vector<LibcameraCamera> listLibcameras() { return {}; }

struct LibcameraMessages::Output {};
LibcameraMessages::LibcameraMessages(Sink /*sink*/) {}
LibcameraMessages::~LibcameraMessages() = default;

}  // namespace waymark::capture
