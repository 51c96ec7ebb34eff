#include "tools/natural/picture_range.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <numbers>
#include <utility>

#include "simulator/printed_image.h"
#include "simulator/renderer.h"
#include "simulator/sensor.h"

namespace waymark::tools {
namespace {

// The print hangs in the plane z = 0 of the world, its centre at the origin.
simulator::Scene sceneOf(const slam::NaturalMarker& marker, const slam::Calibration& camera) {
  simulator::Scene scene{.name = "check",
                         .dictionary = *slam::Dictionary::byName("4X4_50"),
                         .camera = camera,
                         .surfaces = {},
                         .markers = {},
                         .prints = {},
                         .trajectory = {}};
  const double wall_m = 6.0 * std::max(marker.width_m(), marker.height_m());
  simulator::Surface wall;
  wall.T_w_s.p.z() = -0.01 * marker.width_m();
  wall.half_width_m = wall_m;
  wall.half_height_m = wall_m;
  wall.paint = {.contrast = 10.0, .patches_per_m2 = 0.0, .texel_m = wall_m / 400.0};
  scene.surfaces.push_back(wall);
  const auto& grey = marker.grey().level(0);
  const ImageView picture{grey.grey.data(), grey.width, grey.height, grey.width};
  scene.prints.push_back({std::make_shared<simulator::PrintedImage>(picture), marker.width_m(),
                          marker.height_m(), slam::Transform{}});
  return scene;
}

// Looks at the print's centre from the side, tilted about its y axis, a little turned.
slam::Transform viewFrom(double distance_m, double tilt_deg) {
  const double tilt = tilt_deg * std::numbers::pi / 180.0;
  slam::Transform T_c_p;
  Eigen::Matrix3d facing;  // x right, y up, z towards the camera
  facing << 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0;
  constexpr double kRoll_rad = 0.05;
  T_c_p.R = slam::expSo3({0.0, 0.0, kRoll_rad}) * slam::expSo3({0.0, tilt, 0.0}) * facing;
  T_c_p.p = {0.0, 0.0, distance_m};
  return T_c_p;
}

double cornerError_px(const slam::NaturalMarker& marker, const slam::CameraModel& camera,
                      const slam::Transform& a, const slam::Transform& b) {
  double sum = 0.0;
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.5, 0.5}) {
      const Eigen::Vector3d corner(x * marker.width_m(), y * marker.height_m(), 0.0);
      const Eigen::Vector3d pa = a * corner;
      const Eigen::Vector3d pb = b * corner;
      if (pa.z() <= 0.0 || pb.z() <= 0.0) return 1e6;
      sum += 0.25 * camera.focalLength() * (pa.hnormalized() - pb.hnormalized()).norm();
    }
  }
  return sum;
}

// The nearest distance from which all of the print is in the image.
double nearestWhole(const slam::NaturalMarker& marker, const slam::Calibration& camera) {
  constexpr double kPart = 0.9;  // of the image
  return std::max(camera.fx * marker.width_m() / (kPart * camera.width),
                  camera.fy * marker.height_m() / (kPart * camera.height));
}

// A part of an image, and the camera that takes just that.
struct Window {
  ImageView image;
  slam::Calibration camera;
};

// Around the print: local features of a whole image take most of the time, and the wall has none.
Window windowAround(const slam::NaturalMarker& marker, const slam::Transform& T_c_p,
                    const ImageView& image, const slam::Calibration& calibration) {
  constexpr int kMargin_px = 48;  // what the features at the print's edges are told by
  const slam::CameraModel camera(calibration);
  Eigen::Vector2d low(image.width, image.height);
  Eigen::Vector2d high(-1.0, -1.0);
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.5, 0.5}) {
      const Eigen::Vector3d corner(x * marker.width_m(), y * marker.height_m(), 0.0);
      const auto pixel = camera.project(T_c_p * corner);
      if (!pixel) return {image, calibration};
      low = low.cwiseMin(*pixel);
      high = high.cwiseMax(*pixel);
    }
  }
  const auto within = [](double at, int size) {
    return static_cast<int>(std::clamp(at, 0.0, static_cast<double>(size)));
  };
  const int left = within(low.x() - kMargin_px, image.width);
  const int top = within(low.y() - kMargin_px, image.height);
  const int right = within(high.x() + kMargin_px, image.width);
  const int bottom = within(high.y() + kMargin_px, image.height);
  if (left >= right || top >= bottom) return {image, calibration};
  Window window{image, calibration};
  window.image.data = image.row(top) + left;
  window.image.width = window.camera.width = right - left;
  window.image.height = window.camera.height = bottom - top;
  window.camera.cx -= left;
  window.camera.cy -= top;
  return window;
}

// Of first to last, the last one that is found, the first one being found and each one after one
// that is not found being not found either: by strides, then by halves.
int lastFound(int first, int last, const std::function<bool(int)>& isFound) {
  constexpr int kStride = 4;
  int yes = first;
  int no = last + 1;
  const auto ask = [&](int k) {
    if (isFound(k)) {
      yes = k;
    } else {
      no = k;
    }
  };
  while (yes + kStride < no) ask(yes + kStride);
  while (no - yes > 1) ask(yes + (no - yes) / 2);
  return yes;
}

}  // namespace

slam::Calibration ordinaryCamera() {
  return {.width = 640, .height = 480, .fx = 512.0, .fy = 512.0, .cx = 319.5, .cy = 239.5};
}

std::vector<PictureRange> pictureRange(const slam::NaturalMarker& marker, int place,
                                       const slam::Calibration& calibration,
                                       slam::PictureFinder* finder,
                                       const PictureRangeOptions& options) {
  const simulator::Options ordinary;
  auto renderer = simulator::Renderer::create(sceneOf(marker, calibration), 1,
                                              simulator::Sensor::blurRadius(ordinary) + 1);
  if (!renderer) return {};
  const simulator::Sensor sensor(ordinary, {calibration.width, calibration.height});
  simulator::Renderer::Workspace workspace;
  simulator::Sensor::Workspace sensor_workspace;
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(calibration.width) *
                                   static_cast<std::size_t>(calibration.height));
  const ImageView image{pixels.data(), calibration.width, calibration.height, calibration.width};
  std::uint64_t frame = 0;
  const auto isFound = [&](double distance_m, double tilt_deg) {
    const slam::Transform T_c_p = viewFrom(distance_m, tilt_deg);
    renderer->render({{T_c_p.inverse()}}, {}, &workspace);
    sensor.develop(workspace.radiance, 1.0F, frame++, &sensor_workspace, pixels.data());
    const Window window = windowAround(marker, T_c_p, image, calibration);
    const slam::CameraModel camera(window.camera);
    const slam::PictureSearch search = finder->find(window.image, camera);
    return std::ranges::any_of(search.found, [&](const slam::FoundPicture& found) {
      return found.picture == place &&
             cornerError_px(marker, camera, found.alignment.T_c_p, T_c_p) < options.right_px;
    });
  };
  const double near_m = nearestWhole(marker, calibration);
  const auto distance = [&](int k) { return near_m * std::pow(options.step, k); };
  const auto stepsTo = [&](double times) {
    return static_cast<int>(std::floor(std::log(times) / std::log(options.step)));
  };
  const int last = stepsTo(options.longest_m / near_m);
  const int last_first = std::min(last, stepsTo(options.nearest_times));
  std::vector<PictureRange> ranges;
  for (const double tilt_deg : options.tilts_deg) {
    const auto isFoundAt = [&](int k) { return isFound(distance(k), tilt_deg); };
    PictureRange range{.tilt_deg = tilt_deg, .nearest_m = {}, .farthest_m = {}};
    int first = 0;
    while (first <= last_first && !isFoundAt(first)) ++first;
    if (first <= last_first) {
      range.nearest_m = distance(first);
      range.farthest_m = distance(lastFound(first, last, isFoundAt));
    }
    ranges.push_back(range);
  }
  return ranges;
}

}  // namespace waymark::tools
