#include "tools/cameras_command.h"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "capture/libcamera/libcamera_source.h"
#include "capture/mode_choice.h"
#include "capture/pixel_format.h"
#include "capture/v4l2/camera_list.h"
#include "capture/v4l2/controls.h"
#include "capture/v4l2/device.h"
#include "tools/exit_code.h"

namespace waymark::tools {
namespace {

namespace v4l2 = capture::v4l2;

std::string heading(const v4l2::Camera& camera) {
  std::string text = "v4l2:" + camera.path + "\n  card=" + camera.card.name +
                     "\n  bus=" + camera.card.bus + " (" + camera.card.driver + ")\n";
  if (!camera.serial.empty()) text += "  serial=" + camera.serial + "\n";
  for (const std::string& link : camera.links) text += "  " + link + "\n";
  return text;
}

std::string modes(const v4l2::Device& device) {
  std::map<std::uint32_t, std::string> sizes_of;
  for (const capture::OfferedMode& mode : device.modes()) {
    sizes_of[mode.fourcc] += "      " + capture::describeSize(mode) + "\n";
  }
  std::string text = "  formats\n";
  for (const auto& [fourcc, sizes] : sizes_of) {
    const bool usable = capture::findPixelFormat(fourcc) != nullptr;
    text +=
        "    " + capture::fourccText(fourcc) + (usable ? "" : " (cannot be used)") + "\n" + sizes;
  }
  return text;
}

std::string controls(const v4l2::Device& device) {
  const std::vector<v4l2::Control> all = v4l2::listControls(device);
  std::string text = all.empty() ? "" : "  controls\n";
  for (const v4l2::Control& control : all) {
    text += "    " + control.name + ": " +
            v4l2::describeControl(control, v4l2::readControl(device, control)) + "\n";
  }
  return text;
}

std::string describe(const capture::LibcameraCamera& camera, std::size_t number) {
  std::string text = "libcamera:" + std::to_string(number) + "\n  libcamera:" + camera.id + "\n";
  if (!camera.model.empty()) text += "  model " + camera.model + "\n";
  if (!camera.modes.empty()) text += "  formats\n";
  for (const std::string& mode : camera.modes) text += "    " + mode + "\n";
  if (!camera.controls.empty()) text += "  controls\n";
  for (const std::string& control : camera.controls) text += "    " + control + "\n";
  return text;
}

ExitCode printCameras() {
  const v4l2::CameraList list = v4l2::listCameras();
  for (const v4l2::Camera& camera : list.cameras) {
    const Result<v4l2::Device> device = v4l2::Device::open(camera.path);
    const std::string can =
        device ? modes(*device) + controls(*device) : "  " + device.error().message + "\n";
    std::printf("%s%s\n", heading(camera).c_str(), can.c_str());
  }
  const std::vector<capture::LibcameraCamera> others = capture::listLibcameras();
  for (std::size_t i = 0; i < others.size(); ++i) {
    std::printf("%s\n", describe(others[i], i).c_str());
  }
  if (list.cameras.empty() && others.empty()) std::printf("There is no camera.\n");
  for (const std::string& rejected : list.rejected) {
    std::fprintf(stderr, "waymark: not used: %s\n", rejected.c_str());
  }
  return kDone;
}

}  // namespace

void addCamerasCommand(CLI::App& app, int* exit_code) {
  app.add_subcommand("cameras", "List cameras: their names, formats, sizes, rates and controls")
      ->callback([exit_code] { *exit_code = printCameras(); });
}

}  // namespace waymark::tools
