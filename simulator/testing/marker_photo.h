// One marker on its paper as a camera sees it, flat or bent, sharp or not: what detection has to
// cope with, with the truth beside it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "base/image_view.h"
#include "simulator/projected_marker.h"
#include "simulator/random.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

namespace waymark::simulator::testing {

struct MarkerPhotoOptions {
  int id = 0;
  double side_px = 100.0;  // seen from the front
  double tilt_deg = 0.0;
  double blur_px = 0.5;      // standard deviation, beside the pixel's own area
  double noise_sigma = 2.0;  // grey levels
  int image_px = 0;          // width and height of the image; 0: enough for marker and blur
  // Of the white border around the marker, a share of a cell.
  double quiet_zone = 1.0;
  // The paper lies on a cylinder of this radius, in sides of the marker, whose axis is turned from
  // the marker's y by bend_axis_deg; 0: it is flat. Negative: hollow as the camera sees it.
  double bend_radius = 0.0;
  double bend_axis_deg = 0.0;
  double ink = 35.0;  // grey levels
  double paper = 205.0;
  double wall = 120.0;
  std::uint64_t seed = 1;  // of the place, the turn, the direction of the tilt, and the noise
};

class MarkerPhoto {
 public:
  static constexpr double kSize_m = 0.1;

  MarkerPhoto(const slam::Dictionary& dictionary, const MarkerPhotoOptions& options)
      : options_(options), camera_(cameraFor(options)) {
    Random random(options.seed);
    place(&random);
    const int margin = static_cast<int>(std::ceil(4.0 * options.blur_px));
    std::vector<float> light = expose(dictionary, margin);
    blur(margin, &light);
    develop(light, margin, &random);
  }

  [[nodiscard]] ImageView image() const {
    return {pixels_.data(), camera_.width(), camera_.height(), camera_.width()};
  }
  [[nodiscard]] const slam::CameraModel& camera() const { return camera_; }
  // Of the marker if it were flat, touching the paper in its middle.
  [[nodiscard]] const slam::Transform& T_c_m() const { return T_c_m_; }
  // Where the print's corners are, bent as they may be.
  [[nodiscard]] std::array<Eigen::Vector3d, 4> corners_c() const {
    std::array<Eigen::Vector3d, 4> corners = slam::markerCorners(kSize_m);
    for (Eigen::Vector3d& corner : corners) corner = T_c_m_ * bent(corner.head<2>());
    return corners;
  }
  [[nodiscard]] ImageCorners corners() const {
    ImageCorners pixels;
    const auto in_camera = corners_c();
    for (std::size_t k = 0; k < 4; ++k) pixels[k] = *camera_.project(in_camera[k]);
    return pixels;
  }

 private:
  static constexpr int kSamples = 4;  // a pixel, each way

  static slam::CameraModel cameraFor(const MarkerPhotoOptions& options) {
    const int enough_px = static_cast<int>(1.5 * options.side_px + 8.0 * options.blur_px) + 60;
    const int size_px = options.image_px > 0 ? options.image_px : enough_px;
    const double middle = 0.5 * (size_px - 1);
    return slam::CameraModel({.width = size_px,
                              .height = size_px,
                              .fx = 3.0 * options.side_px,
                              .fy = 3.0 * options.side_px,
                              .cx = middle,
                              .cy = middle});
  }

  void place(Random* random) {
    const double turn = random->uniform(0.0, 2.0 * std::numbers::pi);
    const double direction = random->uniform(0.0, 2.0 * std::numbers::pi);
    const double tilt = options_.tilt_deg * std::numbers::pi / 180.0;
    const Eigen::Vector3d axis(std::cos(direction), std::sin(direction), 0.0);
    // The marker's z, out of the print, is towards the camera.
    const Eigen::Matrix3d faced = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    T_c_m_.R = slam::expSo3(tilt * axis) * slam::expSo3({0.0, 0.0, turn}) * faced;
    const double z = camera_.focalLength() * kSize_m / options_.side_px;
    const double per_px = z / camera_.focalLength();
    T_c_m_.p = {per_px * random->uniform(-2.0, 2.0), per_px * random->uniform(-2.0, 2.0), z};
  }

  [[nodiscard]] double curvature()
      const {  // 1/m; positive: the paper's sides are behind its middle
    return options_.bend_radius == 0.0 ? 0.0 : 1.0 / (options_.bend_radius * kSize_m);
  }
  [[nodiscard]] Eigen::Vector2d acrossAxis() const {
    const double angle = options_.bend_axis_deg * std::numbers::pi / 180.0;
    return {std::cos(angle), std::sin(angle)};
  }

  // A place of the print, metres from its middle, on the bent paper.
  [[nodiscard]] Eigen::Vector3d bent(const Eigen::Vector2d& flat) const {
    const double k = curvature();
    const Eigen::Vector2d across = acrossAxis();
    const double s = across.dot(flat);
    if (k == 0.0) return {flat.x(), flat.y(), 0.0};
    const Eigen::Vector2d moved = flat + (std::sin(k * s) / k - s) * across;
    return {moved.x(), moved.y(), (std::cos(k * s) - 1.0) / k};
  }

  // What of the print a ray sees, metres from its middle. Both in the marker's frame.
  [[nodiscard]] std::optional<Eigen::Vector2d> hit(const Eigen::Vector3d& eye,
                                                   const Eigen::Vector3d& ray) const {
    const double k = curvature();
    if (k == 0.0) return Eigen::Vector2d((eye - eye.z() / ray.z() * ray).head<2>());
    // On the cylinder (a . p)^2 + (z + 1/k)^2 = 1/k^2.
    const Eigen::Vector2d across = acrossAxis();
    const double e = across.dot(eye.head<2>());
    const double r = across.dot(ray.head<2>());
    const double a = r * r + ray.z() * ray.z();
    const double half_b = e * r + (eye.z() + 1.0 / k) * ray.z();
    const double c = e * e + eye.z() * eye.z() + 2.0 * eye.z() / k;
    const double discriminant = half_b * half_b - a * c;
    if (discriminant < 0.0) return std::nullopt;
    // The paper is on the nearer half where it bulges, else on the farther one.
    const double t = (-half_b - std::copysign(std::sqrt(discriminant), k)) / a;
    const Eigen::Vector3d p = eye + t * ray;
    const double bent_across = across.dot(p.head<2>());
    const double s = std::asin(std::clamp(k * bent_across, -1.0, 1.0)) / k;
    return Eigen::Vector2d(p.head<2>() + (s - bent_across) * across);
  }

  [[nodiscard]] double levelAt(const slam::Dictionary& dictionary,
                               const std::optional<Eigen::Vector2d>& print) const {
    if (!print) return options_.wall;
    const int cells = dictionary.cells();
    const double column = (print->x() / kSize_m + 0.5) * cells;
    const double row = (0.5 - print->y() / kSize_m) * cells;
    const double outside = std::max({-column, -row, column - cells, row - cells});
    if (outside >= options_.quiet_zone) return options_.wall;
    if (outside >= 0.0) return options_.paper;
    return dictionary.white(options_.id, static_cast<int>(row), static_cast<int>(column))
               ? options_.paper
               : options_.ink;
  }

  // Light on each pixel, with a margin.
  [[nodiscard]] std::vector<float> expose(const slam::Dictionary& dictionary, int margin) const {
    const slam::Transform T_m_c = T_c_m_.inverse();
    const slam::Calibration& c = camera_.calibration();
    std::vector<float> light;
    for (int y = -margin; y < c.height + margin; ++y) {
      for (int x = -margin; x < c.width + margin; ++x) {
        const auto sample = [&](int i, int j) {
          const Eigen::Vector3d ray((x + (i + 0.5) / kSamples - 0.5 - c.cx) / c.fx,
                                    (y + (j + 0.5) / kSamples - 0.5 - c.cy) / c.fy, 1.0);
          return levelAt(dictionary, hit(T_m_c.p, T_m_c.R * ray));
        };
        light.push_back(static_cast<float>(meanOf(sample)));
      }
    }
    return light;
  }

  // Of a pixel's samples. One whose outermost agree lies within a cell, where cells are larger.
  template <typename Sample>
  [[nodiscard]] double meanOf(const Sample& sample) const {
    constexpr int kLast = kSamples - 1;
    constexpr double kManyPixels = 100.0;
    const double level = sample(0, 0);
    if (options_.side_px > kManyPixels && sample(kLast, 0) == level && sample(0, kLast) == level &&
        sample(kLast, kLast) == level) {
      return level;
    }
    double sum = 0.0;
    for (int i = 0; i < kSamples; ++i) {
      for (int j = 0; j < kSamples; ++j) sum += sample(i, j);
    }
    return sum / (kSamples * kSamples);
  }

  // Gaussian, along rows and then along columns.
  void blur(int margin, std::vector<float>* light) const {
    if (margin == 0) return;
    std::vector<float> taps;
    float sum = 0.0F;
    for (int k = -margin; k <= margin; ++k) {
      taps.push_back(
          static_cast<float>(std::exp(-0.5 * (k / options_.blur_px) * (k / options_.blur_px))));
      sum += taps.back();
    }
    const int width = camera_.width() + 2 * margin;
    const int height = camera_.height() + 2 * margin;
    const auto index = [width](int x, int y) {
      return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
             static_cast<std::size_t>(x);
    };
    for (const bool along_rows : {true, false}) {
      std::vector<float> blurred(light->size(), 0.0F);
      for (int y = 0; y < height; ++y) {
        for (int k = -margin; k <= margin; ++k) {
          const float tap = taps[static_cast<std::size_t>(k + margin)] / sum;
          float* const to = blurred.data() + index(0, y);
          if (along_rows) {
            const float* const from = light->data() + index(0, y) + k;
            const int last = std::min(width, width - k);
            for (int x = std::max(0, -k); x < last; ++x) to[x] += tap * from[x];
          } else if (y + k >= 0 && y + k < height) {
            const float* const from = light->data() + index(0, y + k);
            for (int x = 0; x < width; ++x) to[x] += tap * from[x];
          }
        }
      }
      light->swap(blurred);
    }
  }

  void develop(const std::vector<float>& light, int margin, Random* random) {
    const int width = camera_.width() + 2 * margin;
    for (int y = margin; y < camera_.height() + margin; ++y) {
      for (int x = margin; x < camera_.width() + margin; ++x) {
        const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                       static_cast<std::size_t>(x);
        const double level = light[i] + options_.noise_sigma * random->gaussian();
        pixels_.push_back(static_cast<std::uint8_t>(std::clamp(std::lround(level), 0L, 255L)));
      }
    }
  }

  MarkerPhotoOptions options_;
  slam::CameraModel camera_;
  slam::Transform T_c_m_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace waymark::simulator::testing
