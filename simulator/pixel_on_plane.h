// How a pixel lies on a plane: the plane's linear forms over the pixel, and where in it samples are
// taken.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include <Eigen/Core>

#include "simulator/plane_forms.h"
#include "simulator/ray_table.h"

namespace waymark::simulator {

inline constexpr int kSamples = 16;  // per pixel, 4 x 4

// Sixteen places in a pixel, relative to its centre: a 4 x 4 grid sheared so that no two share a
// row or a column. An edge along the pixels is then resolved to 1/16 px. The pattern is its own
// mirror image through the centre.
struct SamplePattern {
  std::array<float, kSamples> x{};
  std::array<float, kSamples> y{};

  constexpr SamplePattern() {
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < 4; ++j) {
        const std::size_t k = 4 * i + j;
        x[k] = (static_cast<float>(i) + (static_cast<float>(j) + 0.5F) / 4.0F) / 4.0F - 0.5F;
        y[k] = (static_cast<float>(j) + (static_cast<float>(3 - i) + 0.5F) / 4.0F) / 4.0F - 0.5F;
      }
    }
  }
};
inline constexpr SamplePattern kPattern;

// A value at the middle of a pixel and its change to the neighbouring pixels.
struct Gradient {
  float centre, by_column, by_row;

  Gradient(const Eigen::Vector3f& form, float x, float y, const Eigen::Matrix2f& d_ray)
      : centre(form[0] * x + form[1] * y + form[2]),
        by_column(form[0] * d_ray(0, 0) + form[1] * d_ray(1, 0)),
        by_row(form[0] * d_ray(0, 1) + form[1] * d_ray(1, 1)) {}

  [[nodiscard]] float reach() const { return 0.5F * (std::abs(by_column) + std::abs(by_row)); }
  [[nodiscard]] float at(std::size_t sample) const {
    return centre + by_column * kPattern.x[sample] + by_row * kPattern.y[sample];
  }
};

// A plane's forms over one pixel of the ray table; (u, v) of the plane are u / w and v / w.
struct PixelOnPlane {
  Gradient u, v, w;

  PixelOnPlane(const PlaneForms& forms, const RayTable& rays, int column, int row)
      : PixelOnPlane(forms, rays.x(row)[column], rays.y(row)[column],
                     raysAround(rays, column, row)) {}

 private:
  PixelOnPlane(const PlaneForms& forms, float x, float y, const Eigen::Matrix2f& d_ray)
      : u(forms.u_over_z, x, y, d_ray),
        v(forms.v_over_z, x, y, d_ray),
        w(forms.inverse_z, x, y, d_ray) {}

  // How the ray changes to the next column and to the next row.
  static Eigen::Matrix2f raysAround(const RayTable& rays, int column, int row) {
    const int before = std::max(column - 1, 0);
    const int after = std::min(column + 1, rays.width() - 1);
    const int above = std::max(row - 1, 0);
    const int below = std::min(row + 1, rays.height() - 1);
    const float per_column = 1.0F / static_cast<float>(after - before);
    const float per_row = 1.0F / static_cast<float>(below - above);
    Eigen::Matrix2f d_ray;
    d_ray << per_column * (rays.x(row)[after] - rays.x(row)[before]),
        per_row * (rays.x(below)[column] - rays.x(above)[column]),
        per_column * (rays.y(row)[after] - rays.y(row)[before]),
        per_row * (rays.y(below)[column] - rays.y(above)[column]);
    return d_ray;
  }
};

}  // namespace waymark::simulator
