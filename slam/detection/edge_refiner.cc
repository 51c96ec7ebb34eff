#include "slam/detection/edge_refiner.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "base/vectorised.h"

namespace waymark::slam {
namespace {

// Along a side, with the border; no dictionary has more.
constexpr std::size_t kMostCells = 32;

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

// Where the samples lie along and across a side, from their offsets to its start. Those outside of
// the window, or of the lens's range, get no weight.
WAYMARK_VECTORISED void layOut(const MarkerSide& side, const Window& window, const float* offset_x,
                               const float* offset_y, EdgeSamples* samples) {
  const auto f = [](double value) { return static_cast<float>(value); };
  const Eigen::Vector2f along = (side.along / side.length).cast<float>();
  const Eigen::Vector2f outward = side.outward.cast<float>();
  const float length_px = f(side.length_px);
  const float margin = f(window.end_margin);
  const float scale = f(side.scale_start);
  const float scale_slope = f(side.scale_end - side.scale_start);
  const float thickness = f(side.thickness_start);
  const float thickness_slope = f(side.thickness_end - side.thickness_start);
  const float outer = f(window.outer);
  const float inner = -f(window.inner);
  const float sine_start = f(side.sine_start);
  const float sine_end = f(side.sine_end);
  const Lanes none{};
  for (std::size_t i = 0; i < samples->count; i += kLanes) {
    const Lanes& x = lanesAt(offset_x, i);
    const Lanes& y = lanesAt(offset_y, i);
    const Lanes t = x * along.x() + y * along.y();
    const Lanes from_start = t * length_px;
    const Lanes from_end = (1.0F - t) * length_px;
    const Lanes distance = (x * outward.x() + y * outward.y()) * (scale + t * scale_slope);
    // False for a NaN.
    const IntLanes inside =
        (from_start >= margin) & (from_end >= margin) & (distance <= outer) & (distance >= inner);
    lanesAt(samples->t.data(), i) = inside ? t : none;
    lanesAt(samples->distance.data(), i) = inside ? distance : none;
    lanesAt(samples->to_start.data(), i) = inside ? from_start * sine_start : none;
    lanesAt(samples->to_end.data(), i) = inside ? from_end * sine_end : none;
    lanesAt(samples->thickness.data(), i) = inside ? thickness + t * thickness_slope : none;
    lanesAt(samples->grey.data(), i) = inside ? lanesAt(samples->grey.data(), i) : none;
    lanesAt(samples->weight.data(), i) = inside ? none + 1.0F : none;
  }
}

// How white the ring behind a side is at each sample. Only the nearest boundary between cells
// matters: cells[j] and cells[j + 1] are before and after the boundary j cells from the start. u is
// MarkerSide::printCoordinate().
WAYMARK_VECTORISED void blendRing(const MarkerSide& side,
                                  const std::array<float, kMostCells + 3>& cells, float blur_px,
                                  EdgeSamples* samples) {
  const auto perspective = static_cast<float>(side.perspective);
  const auto count = static_cast<float>(side.cells);
  const float per_cell = static_cast<float>(side.length_px) / (count * perspective * blur_px);
  for (std::size_t i = 0; i < samples->count; i += kLanes) {
    const Lanes& t = lanesAt(samples->t.data(), i);
    const Lanes d = t + perspective * (1.0F - t);
    const Lanes u = count * t / d;
    const IntLanes boundary = __builtin_convertvector(u + 0.5F, IntLanes);
    NormalLanes step;
    normalAt((u - __builtin_convertvector(boundary, Lanes)) * d * d * per_cell, &step);
    Lanes& white = lanesAt(samples->ring_white.data(), i);
    for (std::size_t k = 0; k < kLanes; ++k) {
      const auto j = static_cast<std::size_t>(boundary[k]);
      white[k] = cells[j] + step.cdf[k] * (cells[j + 1] - cells[j]);
    }
  }
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

EdgeRefiner::EdgeRefiner(const CameraModel& camera, const UndistortionTable& table,
                         const EdgeRefinerOptions& options)
    : camera_(camera), table_(table), options_(options) {}

void EdgeRefiner::gather(const ImageView& image, const MarkerSide& side, double reach_px,
                         int rows) {
  // Along the side's longer axis, and across it from one edge of the window to the other.
  const Eigen::Vector2d delta_px = side.end_px - side.start_px;
  const int major = std::abs(delta_px.x()) >= std::abs(delta_px.y()) ? 0 : 1;
  const int minor = 1 - major;
  const int last_major = (major == 0 ? image.width : image.height) - 1;
  const int last_minor = (major == 0 ? image.height : image.width) - 1;
  const double reach = reach_px * side.length_px / std::abs(delta_px[major]);
  const double from = std::max(0.0, std::ceil(std::min(side.start_px[major], side.end_px[major])));
  const double to =
      std::min<double>(last_major, std::max(side.start_px[major], side.end_px[major]));
  const int most = static_cast<int>(EdgeSamples::kCapacity) / (2 * static_cast<int>(reach) + 2);
  const int step = 1 + static_cast<int>(to - from) / std::clamp(rows, 1, std::max(most, 1));
  const Eigen::Vector2f start = side.start.cast<float>();
  std::size_t count = 0;
  for (int c = static_cast<int>(from); c <= static_cast<int>(to); c += step) {
    const double chord = (c - side.start_px[major]) / delta_px[major];
    const double centre = side.start_px[minor] + chord * delta_px[minor] +
                          4.0 * chord * (1.0 - chord) * side.bulge_px[minor];
    const int low = std::max(0, static_cast<int>(std::ceil(centre - reach)));
    const int high = std::min(last_minor, static_cast<int>(std::floor(centre + reach)));
    for (int r = low; r <= high && count < EdgeSamples::kCapacity; ++r) {
      const int x = major == 0 ? c : r;
      const int y = major == 0 ? r : c;
      const Eigen::Vector2f& place = table_.at(x, y);
      offset_x_[count] = place.x() - start.x();
      offset_y_[count] = place.y() - start.y();
      samples_.grey[count] = static_cast<float>(image.at(x, y));
      ++count;
    }
  }
  while (count % kLanes != 0) {
    offset_x_[count] = offset_y_[count] = std::numeric_limits<float>::quiet_NaN();
    ++count;
  }
  samples_.count = count;
}

void EdgeRefiner::collectSamples(const ImageView& image, const MarkerSide& side, std::size_t index,
                                 const InnerRing* ring, int rows, double blur_px) {
  const Window window = windowFor(side, blur_px, ring != nullptr);
  gather(image, side, std::max(window.outer, window.inner), rows);
  layOut(side, window, offset_x_.data(), offset_y_.data(), &samples_);
  if (ring == nullptr) {
    std::fill_n(samples_.ring_white.begin(), samples_.count, 0.0F);
    return;
  }
  std::array<float, kMostCells + 3> cells{};
  for (std::size_t j = 0; j < cells.size(); ++j) {
    cells[j] = ring->cell(index, static_cast<int>(j) - 1);
  }
  blendRing(side, cells, static_cast<float>(blur_px), &samples_);
}

std::optional<RefinedQuad> EdgeRefiner::refine(const ImageView& image,
                                               const std::array<Eigen::Vector2d, 4>& corners,
                                               int cells, const InnerRing* ring,
                                               std::optional<double> blur_px) {
  RefinedQuad quad;
  quad.normalised = corners;
  std::array<EdgeFit, 4> fits;
  for (EdgeFit& fit : fits) fit.blur_px = blur_px.value_or(options_.initial_blur_px);

  // Where the edge was far from the first guess, the window is laid around it and fitted again.
  constexpr int kPasses = 2;
  const bool rough_first = ring != nullptr && !blur_px;
  bool settled = false;
  for (int pass = rough_first ? -1 : 0; pass < kPasses && !settled; ++pass) {
    const auto sides = layOutSides(camera_, quad.normalised, cells);
    if (!sides) return std::nullopt;
    const int rows = pass < 0 || ring == nullptr ? options_.rows_rough : options_.rows_fine;
    settled = pass >= 0;
    for (std::size_t k = 0; k < 4; ++k) {
      fits[k].shift_start = fits[k].shift_end = 0.0;
      collectSamples(image, (*sides)[k], k, ring, rows, fits[k].blur_px);
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
