#include "capture/v4l2/camera_list.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <utility>

#include <libudev.h>

namespace waymark::capture::v4l2 {
namespace {

namespace fs = std::filesystem;

struct UdevRelease {
  void operator()(udev* u) const { udev_unref(u); }
  void operator()(udev_enumerate* e) const { udev_enumerate_unref(e); }
  void operator()(udev_device* d) const { udev_device_unref(d); }
  void operator()(udev_monitor* m) const { udev_monitor_unref(m); }
};
template <typename T>
using UdevPtr = std::unique_ptr<T, UdevRelease>;

std::string orEmpty(const char* text) { return text == nullptr ? std::string() : text; }

int deviceNumber(const std::string& path) {
  const std::size_t digits = path.find_last_not_of("0123456789") + 1;
  return std::atoi(path.c_str() + digits);
}

std::vector<std::string> linksOf(udev_device* device) {
  std::vector<std::string> links;
  udev_list_entry* entry = nullptr;
  udev_list_entry_foreach(entry, udev_device_get_devlinks_list_entry(device)) {
    links.emplace_back(udev_list_entry_get_name(entry));
  }
  std::ranges::sort(links);
  return links;
}

std::string serialOf(udev_device* device) {
  udev_device* const usb =
      udev_device_get_parent_with_subsystem_devtype(device, "usb", "usb_device");
  return usb == nullptr ? std::string() : orEmpty(udev_device_get_sysattr_value(usb, "serial"));
}

void addDevice(udev_device* device, CameraList* list) {
  const char* const path = udev_device_get_devnode(device);
  if (path == nullptr || !std::string_view(path).starts_with("/dev/video")) return;
  const Result<Device> opened = Device::open(path);
  if (!opened) {
    list->rejected.push_back(opened.error().message);
    return;
  }
  list->cameras.push_back(
      {.path = path,
       .links = linksOf(device),
       .card = opened->card(),
       .serial = serialOf(device),
       .index = std::atoi(orEmpty(udev_device_get_sysattr_value(device, "index")).c_str())});
}

std::string describe(const Camera& camera) {
  std::string text = camera.path + " (" + camera.card.name + ", bus=" + camera.card.bus;
  if (!camera.serial.empty()) text += ", serial=" + camera.serial;
  return text + ")";
}

std::string describe(const std::vector<Camera>& cameras) {
  std::string text;
  for (const Camera& camera : cameras) text += (text.empty() ? "" : "; ") + describe(camera);
  return text;
}

bool isNamed(const Camera& camera, const CameraName& name) {
  switch (name.kind) {
    case CameraName::Kind::kSerial:
      return camera.serial == name.text;
    case CameraName::Kind::kCard:
      return camera.card.name == name.text;
    case CameraName::Kind::kBus:
      return camera.card.bus == name.text;
    case CameraName::Kind::kPath:
      break;
  }
  std::error_code error;
  return camera.path == name.text || fs::canonical(name.text, error) == camera.path;
}

std::string nameText(const CameraName& name) {
  static constexpr std::array kKeys = {"", "serial=", "card=", "bus="};
  return kKeys[static_cast<std::size_t>(name.kind)] + name.text;
}

bool isSamePlace(const Camera& camera, const CameraIdentity& known) {
  return camera.card.name == known.card && camera.card.bus == known.bus &&
         camera.serial == known.serial && camera.index == known.index;
}

bool hasSameSerial(const Camera& camera, const CameraIdentity& known) {
  return known.serial_is_unique && camera.serial == known.serial &&
         camera.card.name == known.card && camera.index == known.index;
}

bool isPlace(const CameraName& name) {
  return name.kind == CameraName::Kind::kBus ||
         (name.kind == CameraName::Kind::kPath && name.text.find("/by-path/") != std::string::npos);
}

template <typename Matches>
std::vector<Camera> allThat(const std::vector<Camera>& cameras, Matches matches) {
  std::vector<Camera> found;
  std::ranges::copy_if(cameras, std::back_inserter(found), matches);
  return found;
}

// One piece of hardware may show several devices, all of one name: the first is the camera.
bool areOnePiece(const std::vector<Camera>& cameras) {
  return std::ranges::all_of(cameras, [&](const Camera& camera) {
    return camera.card.bus == cameras.front().card.bus &&
           camera.card.name == cameras.front().card.name;
  });
}

Result<Camera> onlyOne(const std::vector<Camera>& found, const CameraName& name,
                       const std::vector<Camera>& cameras) {
  if (found.empty()) {
    return Error{"v4l2:" + nameText(name) + ": there is no such camera, " +
                 (cameras.empty() ? "nor any other" : "but " + describe(cameras))};
  }
  if (!areOnePiece(found)) {
    return Error{"v4l2:" + nameText(name) + ": is any of " + describe(found) +
                 "; name it by its bus= or its link in /dev/v4l/by-path"};
  }
  return *std::ranges::min_element(found, {}, &Camera::index);
}

}  // namespace

CameraList listCameras() {
  CameraList list;
  const UdevPtr<udev> context(udev_new());
  const UdevPtr<udev_enumerate> devices(context ? udev_enumerate_new(context.get()) : nullptr);
  if (!devices) return list;
  udev_enumerate_add_match_subsystem(devices.get(), "video4linux");
  udev_enumerate_scan_devices(devices.get());
  udev_list_entry* entry = nullptr;
  udev_list_entry_foreach(entry, udev_enumerate_get_list_entry(devices.get())) {
    const UdevPtr<udev_device> device(
        udev_device_new_from_syspath(context.get(), udev_list_entry_get_name(entry)));
    if (device) addDevice(device.get(), &list);
  }
  std::ranges::sort(list.cameras, {}, [](const Camera& c) { return deviceNumber(c.path); });
  return list;
}

Result<CameraName> parseCameraName(const std::string& text) {
  using Kind = CameraName::Kind;
  const auto after = [&](std::string_view key) { return text.substr(key.size()); };
  CameraName name;
  if (text.starts_with("/")) {
    name = {Kind::kPath, text};
  } else if (text.starts_with("serial=")) {
    name = {Kind::kSerial, after("serial=")};
  } else if (text.starts_with("card=")) {
    name = {Kind::kCard, after("card=")};
  } else if (text.starts_with("bus=")) {
    name = {Kind::kBus, after("bus=")};
  }
  if (!name.text.empty()) return name;
  return Error{"v4l2:" + text +
               ": after v4l2: comes a path (/dev/video0, /dev/v4l/by-path/...), serial=..., "
               "card=... or bus=..., as `waymark cameras` lists them"};
}

CameraIdentity CameraIdentity::of(const Camera& camera, const std::vector<Camera>& all) {
  const auto twins = std::ranges::count_if(all, [&](const Camera& other) {
    return other.serial == camera.serial && other.card.name == camera.card.name &&
           other.index == camera.index;
  });
  return {.card = camera.card.name,
          .bus = camera.card.bus,
          .serial = camera.serial,
          .index = camera.index,
          .serial_is_unique = !camera.serial.empty() && twins == 1};
}

CameraIdentity CameraIdentity::of(const Camera& camera, const std::vector<Camera>& all,
                                  const std::optional<CameraIdentity>& known) {
  CameraIdentity identity = of(camera, all);
  if (known && known->serial == identity.serial && !known->serial_is_unique) {
    identity.serial_is_unique = false;
  }
  return identity;
}

Result<Camera> findCamera(const CameraName& name, const std::optional<CameraIdentity>& known,
                          const std::vector<Camera>& cameras) {
  if (known) {
    const std::vector<Camera> here =
        allThat(cameras, [&](const Camera& camera) { return isSamePlace(camera, *known); });
    if (!here.empty()) return onlyOne(here, name, cameras);
    const std::vector<Camera> moved =
        allThat(cameras, [&](const Camera& camera) { return hasSameSerial(camera, *known); });
    if (moved.size() == 1 && !isPlace(name)) return moved.front();
    // A serial or a card's name is all the user wants of it; a path was only where it was.
    const bool place = name.kind == CameraName::Kind::kPath || name.kind == CameraName::Kind::kBus;
    if (place) {
      return Error{"v4l2:" + nameText(name) + ": '" + known->card + "' is no longer at " +
                   known->bus + "; there is " + describe(cameras)};
    }
  }
  return onlyOne(allThat(cameras, [&](const Camera& c) { return isNamed(c, name); }), name,
                 cameras);
}

struct CameraArrivals::Impl {
  UdevPtr<udev> context;
  UdevPtr<udev_monitor> monitor;
};

CameraArrivals::CameraArrivals() : impl_(std::make_unique<Impl>()) {
  impl_->context.reset(udev_new());
  if (!impl_->context) return;
  // After udev's rules: the links are made, and we may open it.
  impl_->monitor.reset(udev_monitor_new_from_netlink(impl_->context.get(), "udev"));
  udev_monitor* const monitor = impl_->monitor.get();
  if (monitor == nullptr) return;
  udev_monitor_filter_add_match_subsystem_devtype(monitor, "video4linux", nullptr);
  udev_monitor_enable_receiving(monitor);
}

CameraArrivals::~CameraArrivals() = default;

bool CameraArrivals::any() {
  if (!impl_->monitor) return false;
  bool come = false;
  // The monitor's socket does not block: null when there is nothing more.
  while (const UdevPtr<udev_device> device{udev_monitor_receive_device(impl_->monitor.get())}) {
    come |= orEmpty(udev_device_get_action(device.get())) == "add";
  }
  return come;
}

}  // namespace waymark::capture::v4l2
