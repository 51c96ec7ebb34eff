// A wall with papers on it, rendered: what a camera that goes along it sees. Everything from a
// seed.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "base/image_view.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam::testing {

// The lens of a small wide camera: 78 degrees across, with barrel distortion.
inline Calibration wideCalibration(int width, int height) {
  Calibration c{.width = width, .height = height};
  c.fx = c.fy = 0.61 * width;
  c.cx = 0.5 * width - 0.5;
  c.cy = 0.5 * height - 0.5;
  c.distortion = {-0.25, 0.07, 3e-4, -2e-4, -0.008};
  return c;
}

// In the plane y = 0, its face towards -y, z up.
class TexturedWall {
 public:
  static constexpr double kLeft_m = -4.0;
  static constexpr double kTop_m = 1.6;
  static constexpr double kTexel_m = 0.003;
  static constexpr int kColumns = 3600;
  static constexpr int kRows = 1070;

  static constexpr int kSizes = 7;  // of the texture, each half of the one before

  explicit TexturedWall(unsigned seed)
      : texels_(static_cast<std::size_t>(kColumns) * kRows, 160.0F) {
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> u(0.0, 1.0);
    for (int i = 0; i < 700; ++i) {
      const int width = static_cast<int>(12 + 60 * u(rng) * u(rng));
      const int height = static_cast<int>(12 + 60 * u(rng) * u(rng));
      const int left = static_cast<int>(u(rng) * kColumns);
      const int top = static_cast<int>(u(rng) * kRows);
      const auto grey = static_cast<float>(60.0 + 140.0 * u(rng));
      const double slope = 0.4 * (u(rng) - 0.5);
      for (int y = std::max(0, top); y < std::min(kRows, top + height); ++y) {
        const int shift = static_cast<int>(slope * (y - top));
        for (int x = std::max(0, left + shift); x < std::min(kColumns, left + shift + width); ++x) {
          at(x, y) = grey;
        }
      }
    }
    // As wide as a camera's blur at a metre.
    blur(1, 0);
    blur(0, 1);
    blur(1, 0);
    blur(0, 1);
    makeSizes();
  }

  // noise: of a pixel, grey levels.
  void render(const CameraModel& camera, const Transform& T_w_c, double noise, unsigned seed,
              std::vector<std::uint8_t>* pixels) {
    renderRows(
        camera, [&](int) { return T_w_c; }, noise, seed, pixels);
  }
  // The same through a rolling shutter: poseOf(row) is where the camera is when it reads a row.
  template <typename PoseOf>
  void renderRows(const CameraModel& camera, const PoseOf& poseOf, double noise, unsigned seed,
                  std::vector<std::uint8_t>* pixels) {
    const auto width = static_cast<std::size_t>(camera.width());
    const auto height = static_cast<std::size_t>(camera.height());
    if (rays_.size() != width * height) makeRays(camera);
    if (noise_.empty()) makeNoise();
    pixels->resize(width * height);
    std::size_t next = (seed * 7919U) % (noise_.size() / 2);
    Eigen::Matrix3f R;
    Eigen::Vector3f eye;
    for (std::size_t i = 0; i < pixels->size(); ++i) {
      if (i % width == 0) {
        const Transform T_w_c = poseOf(static_cast<int>(i / width));
        R = T_w_c.R.cast<float>();
        eye = T_w_c.p.cast<float>();
      }
      const Eigen::Vector3f ray = R * Eigen::Vector3f(rays_[i].x(), rays_[i].y(), 1.0F);
      float grey = kBeyond;
      if (ray.y() > 0.02F) {
        const float distance = -eye.y() / ray.y();
        // Texels of a pixel: the geometric mean of both directions on the wall.
        const float texels = distance / static_cast<float>(camera.focalLength() * kTexel_m) /
                             std::sqrt(ray.y() / ray.norm());
        grey = sample(eye.x() + distance * ray.x(), eye.z() + distance * ray.z(), texels);
      }
      if (++next >= noise_.size()) next = 0;
      grey += static_cast<float>(noise) * noise_[next];
      (*pixels)[i] = static_cast<std::uint8_t>(std::clamp(grey + 0.5F, 0.0F, 255.0F));
    }
  }

 private:
  float& at(int x, int y) {
    return texels_[static_cast<std::size_t>(y) * kColumns + static_cast<std::size_t>(x)];
  }
  [[nodiscard]] float at(int x, int y) const {
    return texels_[static_cast<std::size_t>(y) * kColumns + static_cast<std::size_t>(x)];
  }
  void blur(int dx, int dy) {
    std::vector<float> out = texels_;
    for (int y = 1; y + 1 < kRows; ++y) {
      for (int x = 1; x + 1 < kColumns; ++x) {
        out[static_cast<std::size_t>(y) * kColumns + static_cast<std::size_t>(x)] =
            0.25F * at(x - dx, y - dy) + 0.5F * at(x, y) + 0.25F * at(x + dx, y + dy);
      }
    }
    texels_ = out;
  }
  struct Size {
    int columns, rows;
    std::vector<float> texels;
  };
  void makeSizes() {
    sizes_.push_back({kColumns, kRows, texels_});
    while (sizes_.size() < kSizes) {
      const Size& from = sizes_.back();
      Size to{from.columns / 2, from.rows / 2, {}};
      for (int y = 0; y < to.rows; ++y) {
        for (int x = 0; x < to.columns; ++x) {
          const auto at = static_cast<std::size_t>(2 * y * from.columns + 2 * x);
          const auto below = at + static_cast<std::size_t>(from.columns);
          to.texels.push_back(0.25F * (from.texels[at] + from.texels[at + 1] + from.texels[below] +
                                       from.texels[below + 1]));
        }
      }
      sizes_.push_back(std::move(to));
    }
  }
  // texels: of the full size, that a pixel covers. Between two sizes, as both say.
  [[nodiscard]] float sample(float x_m, float z_m, float texels) const {
    const float level = std::max(0.0F, std::log2(texels));
    const int lower = static_cast<int>(level);
    if (lower + 1 >= kSizes) return kBeyond;
    const float share = level - static_cast<float>(lower);
    return (1.0F - share) * sampleSize(x_m, z_m, lower) + share * sampleSize(x_m, z_m, lower + 1);
  }
  [[nodiscard]] float sampleSize(float x_m, float z_m, int level) const {
    const Size& size = sizes_[static_cast<std::size_t>(level)];
    const float per_metre = 1.0F / (static_cast<float>(kTexel_m) * static_cast<float>(1 << level));
    const float x = (x_m - static_cast<float>(kLeft_m)) * per_metre - 0.5F;
    const float y = (static_cast<float>(kTop_m) - z_m) * per_metre - 0.5F;
    if (!(x >= 0.0F) || !(y >= 0.0F)) return kBeyond;
    const int column = static_cast<int>(x);
    const int row = static_cast<int>(y);
    if (column + 1 >= size.columns || row + 1 >= size.rows) return kBeyond;
    const float fx = x - static_cast<float>(column);
    const float fy = y - static_cast<float>(row);
    const float* const p =
        size.texels.data() + static_cast<std::ptrdiff_t>(row) * size.columns + column;
    const float above = p[0] * (1.0F - fx) + p[1] * fx;
    const float below = p[size.columns] * (1.0F - fx) + p[size.columns + 1] * fx;
    return above * (1.0F - fy) + below * fy;
  }
  void makeRays(const CameraModel& camera) {
    rays_.clear();
    for (int y = 0; y < camera.height(); ++y) {
      for (int x = 0; x < camera.width(); ++x) {
        rays_.push_back(camera.undistort({x, y}).value_or(Eigen::Vector2d(0, 0)).cast<float>());
      }
    }
  }
  void makeNoise() {
    std::mt19937 rng(99);
    std::normal_distribution<float> n(0.0F, 1.0F);
    noise_.resize(1U << 20U);
    for (float& v : noise_) v = n(rng);
  }

  static constexpr float kBeyond = 110.0F;  // grey level of what is not the wall
  std::vector<float> texels_;
  std::vector<Size> sizes_;
  std::vector<Eigen::Vector2f> rays_;
  std::vector<float> noise_;
};

// A dolly along the wall, 0.9 m from it, the camera panned by 45 degrees (seed 2, section 4.1).
struct Dolly {
  double speed_m_per_s = 0.4;
  unsigned seed = 1;

  [[nodiscard]] Transform at(double t) const {
    const auto sway = [&](int i, double hz) {
      return std::sin(6.2832 * hz * t + 1.7 * i + 0.9 * seed);
    };
    const Eigen::Vector3d eye(-1.6 + speed_m_per_s * t, -0.9 + 0.006 * sway(1, 0.4),
                              0.006 * sway(2, 0.6));
    Transform T = lookAt(eye, eye + Eigen::Vector3d(1.0, 1.0, 0.0));
    T.R = T.R * expSo3({0.006 * sway(3, 0.8), 0.008 * sway(4, 0.5), 0.006 * sway(5, 0.7)});
    return T;
  }
};

}  // namespace waymark::slam::testing
