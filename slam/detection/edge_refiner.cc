#include "slam/detection/edge_refiner.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace waymark::slam {
namespace {

constexpr std::size_t kMaxSamples = 2048;  // per side

// How far from the side pixels are looked at, and how near its ends, pixels.
struct Window {
  double outer;
  double inner;
  double end_margin;
};

// Wide enough for the blur, but not beyond what the model knows: outside, the quiet zone is taken
// to be as wide as the border; inside, the cells behind the border are known only with the code.
Window windowFor(const MarkerSide& side, double blur_px, bool code_known) {
  constexpr double kNarrowest = 1.5;
  const double wanted = 2.5 * blur_px + 0.7;
  const double border = std::min(side.thickness_start, side.thickness_end);
  const auto within = [&](double share) {
    return std::clamp(wanted, kNarrowest, std::max(kNarrowest, share * border));
  };
  return {within(0.9), within(code_known ? 1.0 : 0.6),
          std::min(1.2 * blur_px + 0.5, 0.25 * side.length_px)};
}

// The line of a side moved by its fit: (n, c) with n . p + c = 0, up to scale.
Eigen::Vector3d movedLine(const MarkerSide& side, const EdgeFit& fit) {
  const Eigen::Vector2d a = side.start + side.outward * (fit.shift_start / side.scale_start);
  const Eigen::Vector2d b = side.end + side.outward * (fit.shift_end / side.scale_end);
  const Eigen::Vector2d n(-(b - a).y(), (b - a).x());
  return Eigen::Vector3d(n.x(), n.y(), -n.dot(a)).normalized();
}

struct Corner {
  Eigen::Vector2d normalised;
  Eigen::Matrix2d covariance;
};

// Where the end of side `in` meets the start of side `out`. Empty when they are nearly parallel.
std::optional<Corner> intersect(const MarkerSide& in, const EdgeFit& in_fit, const MarkerSide& out,
                                const EdgeFit& out_fit, double systematic_sigma_px) {
  constexpr double kNearlyParallel = 0.05;  // sine of the angle between them
  Eigen::Matrix2d normals;
  normals.row(0) = in.outward;
  normals.row(1) = out.outward;
  if (!(std::abs(normals.determinant()) > kNearlyParallel)) return std::nullopt;
  const Eigen::Vector3d meet = movedLine(in, in_fit).cross(movedLine(out, out_fit));
  Corner corner;
  corner.normalised = meet.head<2>() / meet.z();
  if (!corner.normalised.allFinite()) return std::nullopt;
  // A corner moves so that both lines still pass through it: normals * d = (shift in, shift out).
  const Eigen::Matrix2d inverse = normals.inverse();
  const Eigen::Vector2d variance(in_fit.covariance(1, 1) / (in.scale_end * in.scale_end),
                                 out_fit.covariance(0, 0) / (out.scale_start * out.scale_start));
  corner.covariance = inverse * variance.asDiagonal() * inverse.transpose();
  const double systematic = systematic_sigma_px / in.scale_end;
  corner.covariance.diagonal().array() += systematic * systematic;
  return corner;
}

double largestShift(const EdgeFit& fit) {
  return std::max(std::abs(fit.shift_start), std::abs(fit.shift_end));
}

}  // namespace

InnerRing InnerRing::of(const Dictionary& dictionary, int id) {
  const int n = dictionary.side();
  InnerRing ring;
  ring.cells_per_side = n;
  for (int j = 0; j < n; ++j) {
    const auto bit = [&](int row, int column) {
      return static_cast<std::uint32_t>(dictionary.white(id, row, column) ? 1U : 0U) << j;
    };
    ring.white[0] |= bit(1, 1 + j);
    ring.white[1] |= bit(1 + j, n);
    ring.white[2] |= bit(n, n - j);
    ring.white[3] |= bit(n - j, 1);
  }
  return ring;
}

float InnerRing::whiteness(std::size_t side, double u, double blur_cells) const {
  const auto cell = [&](int j) {
    return j >= 0 && j < cells_per_side && ((white[side] >> j) & 1U) != 0 ? 1.0F : 0.0F;
  };
  // Only the nearest boundary between cells matters; the border's cell comes before cell 0.
  const double boundary = std::round(u);
  const int after = static_cast<int>(boundary) - 1;
  const float blend = blurredStep(static_cast<float>((u - boundary) / blur_cells));
  return cell(after - 1) + blend * (cell(after) - cell(after - 1));
}

EdgeRefiner::EdgeRefiner(const CameraModel& camera, const UndistortionTable& table,
                         const EdgeRefinerOptions& options)
    : camera_(camera), table_(table), options_(options) {
  samples_.reserve(kMaxSamples);
}

void EdgeRefiner::collectSamples(const ImageView& image, const MarkerSide& side, std::size_t index,
                                 const InnerRing* ring, double blur_px) {
  samples_.clear();
  const Window window = windowFor(side, blur_px, ring != nullptr);
  // Walk along the side's longer axis, and across it from one edge of the window to the other.
  const Eigen::Vector2d delta_px = side.end_px - side.start_px;
  const int major = std::abs(delta_px.x()) >= std::abs(delta_px.y()) ? 0 : 1;
  const int minor = 1 - major;
  const int last_major = (major == 0 ? image.width : image.height) - 1;
  const int last_minor = (major == 0 ? image.height : image.width) - 1;
  const double reach =
      std::max(window.outer, window.inner) * side.length_px / std::abs(delta_px[major]);
  const double from = std::max(0.0, std::ceil(std::min(side.start_px[major], side.end_px[major])));
  const double to =
      std::min<double>(last_major, std::max(side.start_px[major], side.end_px[major]));
  const int rows = std::min(ring != nullptr ? options_.rows_fine : options_.rows_rough,
                            static_cast<int>(kMaxSamples) / (2 * static_cast<int>(reach) + 2));
  const int step = 1 + static_cast<int>(to - from) / std::max(rows, 1);
  for (int c = static_cast<int>(from); c <= static_cast<int>(to); c += step) {
    const double chord = (c - side.start_px[major]) / delta_px[major];
    const double centre = side.start_px[minor] + chord * delta_px[minor] +
                          4.0 * chord * (1.0 - chord) * side.bulge_px[minor];
    const int low = std::max(0, static_cast<int>(std::ceil(centre - reach)));
    const int high = std::min(last_minor, static_cast<int>(std::floor(centre + reach)));
    for (int r = low; r <= high && samples_.size() < kMaxSamples; ++r) {
      const int x = major == 0 ? c : r;
      const int y = major == 0 ? r : c;
      const Eigen::Vector2d offset = table_.at(x, y).cast<double>() - side.start;
      const double t = offset.dot(side.along) / side.length;
      const double from_start = t * side.length_px;
      const double from_end = (1.0 - t) * side.length_px;
      if (!(from_start >= window.end_margin) || !(from_end >= window.end_margin)) continue;
      const auto mix = [t](double start, double end) { return start + t * (end - start); };
      const double distance = offset.dot(side.outward) * mix(side.scale_start, side.scale_end);
      if (distance > window.outer || distance < -window.inner) continue;
      const float ring_white = ring == nullptr ? 0.0F
                                               : ring->whiteness(index, side.printCoordinate(t),
                                                                 blur_px / side.pixelsPerCell(t));
      samples_.push_back(
          {.distance = static_cast<float>(distance),
           .t = static_cast<float>(t),
           .to_start = static_cast<float>(from_start * side.sine_start),
           .to_end = static_cast<float>(from_end * side.sine_end),
           .thickness = static_cast<float>(mix(side.thickness_start, side.thickness_end)),
           .ring_white = ring_white,
           .grey = static_cast<float>(image.at(x, y))});
    }
  }
}

std::optional<RefinedQuad> EdgeRefiner::refine(const ImageView& image,
                                               const std::array<Eigen::Vector2d, 4>& corners_px,
                                               int cells, const InnerRing* ring,
                                               std::optional<double> blur_px) {
  RefinedQuad quad;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto normalised = camera_.undistort(corners_px[k]);
    if (!normalised) return std::nullopt;
    quad.normalised[k] = *normalised;
  }
  std::array<EdgeFit, 4> fits;
  for (EdgeFit& fit : fits) fit.blur_px = blur_px.value_or(options_.initial_blur_px);

  // Where the edge was far from the first guess, the window is laid around it and fitted again.
  constexpr int kPasses = 2;
  bool settled = false;
  for (int pass = 0; pass < kPasses && !settled; ++pass) {
    const auto sides = layOutSides(camera_, quad.normalised, cells);
    if (!sides) return std::nullopt;
    settled = true;
    for (std::size_t k = 0; k < 4; ++k) {
      fits[k].shift_start = fits[k].shift_end = 0.0;
      collectSamples(image, (*sides)[k], k, ring, fits[k].blur_px);
      const auto fit = fitEdge(samples_, fits[k], options_.fit);
      if (!fit) return std::nullopt;
      fits[k] = *fit;
      settled = settled && largestShift(*fit) < options_.settled_shift_px;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t before = (k + 3) % 4;
      const auto corner = intersect((*sides)[before], fits[before], (*sides)[k], fits[k],
                                    options_.systematic_sigma_px);
      if (!corner) return std::nullopt;
      quad.normalised[k] = corner->normalised;
      quad.covariance[k] = corner->covariance;
    }
  }
  for (std::size_t k = 0; k < 4; ++k) {
    quad.pixels[k] = camera_.distort(quad.normalised[k]);
    quad.black += 0.25 * fits[k].black;
    quad.white += 0.25 * fits[k].white;
    quad.blur_px += 0.25 * fits[k].blur_px;
  }
  return quad;
}

}  // namespace waymark::slam
