#include "capture/libcamera/manager.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <mutex>
#include <utility>
#include <vector>

#include "base/system_reason.h"

namespace waymark::capture::libcam {
namespace {

using Manager = libcamera::CameraManager;

bool isNumber(const std::string& name) {
  return !name.empty() && name.size() < 4 &&
         std::ranges::all_of(name, [](unsigned char c) { return std::isdigit(c) != 0; });
}

}  // namespace

void quietUnlessAsked() { setenv("LIBCAMERA_LOG_LEVELS", "*:ERROR", /*overwrite=*/0); }

Result<std::shared_ptr<Manager>> sharedManager() {
  static std::mutex mutex;
  static std::weak_ptr<Manager> current;
  const std::lock_guard lock(mutex);
  if (std::shared_ptr<Manager> manager = current.lock()) return manager;
  const std::shared_ptr<Manager> manager(new Manager, [](Manager* m) {
    m->stop();
    delete m;
  });
  if (const int error = manager->start(); error != 0) {
    return Error{"libcamera cannot be started: " + systemReason(-error)};
  }
  current = manager;
  return manager;
}

Result<std::shared_ptr<libcamera::Camera>> findCamera(const Manager& manager,
                                                      const std::string& name) {
  const std::vector<std::shared_ptr<libcamera::Camera>> cameras = manager.cameras();
  std::string known;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i]->id() == name || (isNumber(name) && std::stoul(name) == i)) return cameras[i];
    known += (i == 0 ? "" : ", ") + std::to_string(i) + " (" + cameras[i]->id() + ")";
  }
  return Error{"libcamera:" + name + ": there is no such camera, " +
               (known.empty() ? "nor any other" : "but " + known)};
}

Result<AcquiredCamera> AcquiredCamera::acquire(std::shared_ptr<libcamera::Camera> camera) {
  if (const int error = camera->acquire(); error != 0) {
    const std::string busy = error == -EBUSY ? " (another program uses it)" : "";
    return Error{camera->id() + ": cannot be taken: " + systemReason(-error) + busy};
  }
  return AcquiredCamera(std::move(camera));
}

AcquiredCamera::~AcquiredCamera() {
  if (camera_) camera_->release();
}

}  // namespace waymark::capture::libcam
