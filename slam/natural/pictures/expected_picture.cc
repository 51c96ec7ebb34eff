#include "slam/natural/pictures/expected_picture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "slam/geometry/polygon.h"

namespace waymark::slam {
namespace {

// Points along the print's edge, in turn: its image bulges with the lens.
std::vector<Eigen::Vector3d> edgePoints(const NaturalMarker& marker) {
  constexpr int kPerSide = 4;
  const double x = 0.5 * marker.width_m();
  const double y = 0.5 * marker.height_m();
  const std::array<Eigen::Vector2d, 4> corners = {Eigen::Vector2d(-x, y), Eigen::Vector2d(x, y),
                                                  Eigen::Vector2d(x, -y), Eigen::Vector2d(-x, -y)};
  std::vector<Eigen::Vector3d> points;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d& a = corners[k];
    const Eigen::Vector2d& b = corners[(k + 1) % 4];
    for (int i = 0; i < kPerSide; ++i) {
      const Eigen::Vector2d p = a + (b - a) * i / kPerSide;
      points.emplace_back(p.x(), p.y(), 0.0);
    }
  }
  return points;
}

// First and last pixel each way.
struct Box {
  int left, top, right, bottom;
};

// Empty when it is outside the image. The last row and column of the image are left out: each pixel
// is measured by its neighbours to the right and below.
std::optional<Box> boxAround(const NaturalMarker& marker, const Transform& T_c_p, int level,
                             int margin_px, const CameraModel& camera) {
  const int last_x = (camera.width() >> level) - 2;
  const int last_y = (camera.height() >> level) - 2;
  Eigen::Vector2d low(1e9, 1e9);
  Eigen::Vector2d high(-1e9, -1e9);
  for (const Eigen::Vector3d& p : edgePoints(marker)) {
    const auto pixel = camera.project(T_c_p * p);
    if (!pixel) {  // it reaches around the lens: the whole image
      low = {0.0, 0.0};
      high = {1e9, 1e9};
      break;
    }
    const Eigen::Vector2d at(toLevel(pixel->x(), level), toLevel(pixel->y(), level));
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  const auto clamped = [](double value, int last) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(last)));
  };
  if (low.x() > last_x || low.y() > last_y || high.x() < 0.0 || high.y() < 0.0) return std::nullopt;
  return Box{clamped(std::floor(low.x()) - margin_px, last_x),
             clamped(std::floor(low.y()) - margin_px, last_y),
             clamped(std::ceil(high.x()) + margin_px, last_x),
             clamped(std::ceil(high.y()) + margin_px, last_y)};
}

// Where rays meet the print's plane.
class PlaneHit {
 public:
  explicit PlaneHit(const Transform& T_c_p) : T_p_c_(T_c_p.inverse()) {}
  [[nodiscard]] bool seesFront() const { return T_p_c_.p.z() > 1e-6; }
  // Not a number where the ray does not meet it in front of the camera.
  [[nodiscard]] Eigen::Vector2f at(const Eigen::Vector2f& ray) const {
    const Eigen::Vector3d d = T_p_c_.R * ray.cast<double>().homogeneous();
    const double s = -T_p_c_.p.z() / d.z();
    constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
    if (!(s > 0.0)) return {kNone, kNone};
    return (T_p_c_.p.head<2>() + s * d.head<2>()).cast<float>();
  }

 private:
  Transform T_p_c_;
};

// The mean of the print's grey levels over a pixel, a parallelogram on it. `at`, `right`, `down`:
// its centre and sides, metres.
float greyOver(const NaturalMarker& marker, const Eigen::Vector2f& at, const Eigen::Vector2f& right,
               const Eigen::Vector2f& down) {
  constexpr int kPlaces = 4;  // each way
  const Eigen::Vector2f scale = marker.pixelsPerMetre().cast<float>();
  const Eigen::Vector2f side_a(right.x() * scale.x(), -right.y() * scale.y());
  const Eigen::Vector2f side_b(down.x() * scale.x(), -down.y() * scale.y());
  // Levels whose pixels are about as large as the places are apart on the longer side.
  const float apart = std::max(side_a.norm(), side_b.norm()) / kPlaces;
  const int last = marker.grey().levels() - 1;
  const int level = std::clamp(static_cast<int>(std::lround(std::log2(apart))), 0, last);
  const GreyImage<std::uint8_t>& grey = marker.grey().level(level);
  const Eigen::Vector2d centre = marker.toPixel(at.cast<double>());
  const float shrink = 1.0F / static_cast<float>(1 << level);
  const auto x0 = static_cast<float>(toLevel(centre.x(), level));
  const auto y0 = static_cast<float>(toLevel(centre.y(), level));
  float sum = 0.0F;
  for (int i = 0; i < kPlaces; ++i) {
    const float u = (static_cast<float>(i) + 0.5F) / kPlaces - 0.5F;
    for (int k = 0; k < kPlaces; ++k) {
      const float v = (static_cast<float>(k) + 0.5F) / kPlaces - 0.5F;
      sum += grey.at(x0 + shrink * (u * side_a.x() + v * side_b.x()),
                     y0 + shrink * (u * side_a.y() + v * side_b.y()));
    }
  }
  return sum / (kPlaces * kPlaces);
}

// Pixels from the print's edge.
float insideBy(const NaturalMarker& marker, const Eigen::Vector2f& at, const Eigen::Vector2f& right,
               const Eigen::Vector2f& down) {
  const float x = static_cast<float>(0.5 * marker.width_m()) - std::abs(at.x());
  const float y = static_cast<float>(0.5 * marker.height_m()) - std::abs(at.y());
  return std::min(x / (std::abs(right.x()) + std::abs(down.x())),
                  y / (std::abs(right.y()) + std::abs(down.y())));
}

}  // namespace

double coveredArea_px(const NaturalMarker& marker, const Transform& T_c_p,
                      const CameraModel& camera) {
  std::vector<Eigen::Vector2d> outline;
  for (const Eigen::Vector3d& p : edgePoints(marker)) {
    const auto pixel = camera.project(T_c_p * p);
    if (!pixel) return 0.0;
    outline.push_back(*pixel);
  }
  return polygonArea(outline);
}

std::optional<ExpectedPicture> expectPicture(const NaturalMarker& marker, const Transform& T_c_p,
                                             int level, int margin_px, PixelRays* rays) {
  const PlaneHit plane(T_c_p);
  if (!plane.seesFront()) return std::nullopt;
  const auto box = boxAround(marker, T_c_p, level, margin_px, rays->camera());
  if (!box) return std::nullopt;
  ExpectedPicture expected;
  expected.level = level;
  expected.left = box->left;
  expected.top = box->top;
  expected.width = box->right - box->left + 1;
  expected.height = box->bottom - box->top + 1;

  // One more to the right and below, for the differences.
  const auto columns = static_cast<std::size_t>(expected.width) + 1;
  std::vector<Eigen::Vector2f> hits(columns * (static_cast<std::size_t>(expected.height) + 1));
  for (int y = 0; y <= expected.height; ++y) {
    for (int x = 0; x <= expected.width; ++x) {
      hits[static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x)] =
          plane.at(rays->atLevel(expected.left + x, expected.top + y, level));
    }
  }
  const std::size_t count =
      static_cast<std::size_t>(expected.width) * static_cast<std::size_t>(expected.height);
  expected.grey.reserve(count);
  expected.on_print.reserve(count);
  expected.inside_px.reserve(count);
  for (int y = 0; y < expected.height; ++y) {
    const Eigen::Vector2f* row = hits.data() + static_cast<std::size_t>(y) * columns;
    for (int x = 0; x < expected.width; ++x) {
      const Eigen::Vector2f& at = row[x];
      const Eigen::Vector2f right = row[x + 1] - at;
      const Eigen::Vector2f down = row[static_cast<std::size_t>(x) + columns] - at;
      constexpr float kElsewhere_px = -1e6F;
      const bool known = std::isfinite(at.x() + right.x() + down.x());
      const float inside = known ? insideBy(marker, at, right, down) : kElsewhere_px;
      const bool wanted = inside > -static_cast<float>(margin_px);
      expected.on_print.push_back(at);
      expected.inside_px.push_back(inside);
      expected.grey.push_back(wanted ? greyOver(marker, at, right, down) : 0.0F);
    }
  }
  return expected;
}

}  // namespace waymark::slam
