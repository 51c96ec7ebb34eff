// Which cameras there are, and which of them is meant.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "capture/v4l2/device.h"

namespace waymark::capture::v4l2 {

// A device that takes pictures.
struct Camera {
  std::string path;                // "/dev/video0": another one after the next start, perhaps
  std::vector<std::string> links;  // names that udev gave it, such as "/dev/v4l/by-path/..."
  Card card;
  std::string serial;  // of its USB device; empty when it has none
  int index = 0;       // among the video devices of the same piece of hardware
};

struct CameraList {
  std::vector<Camera> cameras;        // in the order of their paths' numbers
  std::vector<std::string> rejected;  // video devices that could not be asked, with the reason
};
[[nodiscard]] CameraList listCameras();

// How a user names a camera, after "v4l2:": a path ("/dev/video0", a link to it), "serial=...",
// "card=..." or "bus=...".
struct CameraName {
  enum class Kind { kPath, kSerial, kCard, kBus };
  Kind kind = Kind::kPath;
  std::string text;
};
[[nodiscard]] Result<CameraName> parseCameraName(const std::string& text);

// What stays of a camera while it is unplugged.
struct CameraIdentity {
  std::string card, bus, serial;
  int index = 0;
  bool serial_is_unique = false;  // no other camera had the same name and serial

  [[nodiscard]] static CameraIdentity of(const Camera& camera, const std::vector<Camera>& all);
  // The same, of a camera that was known before: a serial that another one had once is not unique
  // because that one is unplugged now.
  [[nodiscard]] static CameraIdentity of(const Camera& camera, const std::vector<Camera>& all,
                                         const std::optional<CameraIdentity>& known);
};

// The camera among `cameras` that `name` means. Once it was opened, `known` says which it was: the
// same card at the same place, or, moved to another, one with the same unique serial; never another
// camera that happens to have got its number. One that is named by its place (bus=, by-path) is
// there or nowhere. Errors say what there is.
[[nodiscard]] Result<Camera> findCamera(const CameraName& name,
                                        const std::optional<CameraIdentity>& known,
                                        const std::vector<Camera>& cameras);

// Notices that a video device has come, so that nobody need wait for the end of a pause.
class CameraArrivals {
 public:
  CameraArrivals();
  ~CameraArrivals();
  CameraArrivals(const CameraArrivals&) = delete;
  CameraArrivals& operator=(const CameraArrivals&) = delete;

  // True when one has come since the last call. Where the system tells us nothing, never.
  [[nodiscard]] bool any();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace waymark::capture::v4l2
