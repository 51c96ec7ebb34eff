#include "slam/detection/edge_refiner.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <Eigen/Geometry>
#include <Eigen/LU>
namespace waymark::slam {
namespace {

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

// How white the cell behind the border is at t. Only the nearest boundary between cells matters.
float ringWhite(const MarkerSide& side, const InnerRing& ring, std::size_t index, double t,
                double blur_px) {
  const double d = t + side.perspective * (1.0 - t);
  const double u = side.cells * t / d;  // MarkerSide::printCoordinate()
  const int boundary = static_cast<int>(u + 0.5);
  const float before = ring.cell(index, boundary - 1);
  const float after = ring.cell(index, boundary);
  if (before == after) return before;
  const double per_cell = side.length_px / (side.cells * side.perspective * blur_px);
  BlurredStep<float> step{};
  blurredStepAt(static_cast<float>((u - boundary) * d * d * per_cell), &step);
  return before + step.height * (after - before);
}

// What lies beyond 0 .. last goes to the nearer end, however far away it is.
int inRange(double value, int last) {
  if (!(value > 0.0)) return 0;
  return value < last ? static_cast<int>(value) : last;
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

EdgeRefiner::EdgeRefiner(const CameraModel& camera, const EdgeRefinerOptions& options)
    : camera_(camera), options_(options) {}

void EdgeRefiner::layOutRows(const ImageView& image, const std::array<MarkerSide, 4>& sides,
                             std::size_t index, const InnerRing* ring, int most_rows,
                             double blur_px) {
  const MarkerSide& side = sides[index];
  const Window window = windowFor(side, blur_px, ring != nullptr);
  // Rows follow each other along the side's longer axis, and cross it along the other.
  const Eigen::Vector2d delta_px = side.end_px - side.start_px;
  const int major = std::abs(delta_px.x()) >= std::abs(delta_px.y()) ? 0 : 1;
  const int minor = 1 - major;
  const int last_major = (major == 0 ? image.width : image.height) - 1;
  const int last_minor = (major == 0 ? image.height : image.width) - 1;
  const double reach =
      std::max(window.outer, window.inner) * side.length_px / std::abs(delta_px[major]);
  const auto across = std::min(static_cast<std::size_t>(2.0 * reach) + 1, EdgeRows::kMostAcross);
  rows_.clear(across);
  const auto inwards = [&](const MarkerSide& neighbour) {  // per pixel of a row
    const Eigen::Vector2d along = (neighbour.end_px - neighbour.start_px).normalized();
    return static_cast<float>(minor == 0 ? -along.y() : along.x());
  };
  rows_.to_start_step = inwards(sides[(index + 3) % 4]);
  rows_.to_end_step = inwards(sides[(index + 1) % 4]);

  const double margin_t = window.end_margin / side.length_px;
  Eigen::Vector2d derivative;
  const double from = side.pixelAt(margin_t, &derivative)[major];
  const double to = side.pixelAt(1.0 - margin_t, &derivative)[major];
  const int first = inRange(std::ceil(std::min(from, to)), last_major);
  const int last = inRange(std::floor(std::max(from, to)), last_major);
  const int most = std::min(most_rows, static_cast<int>(EdgeRows::kMostRows));
  const int step = 1 + (last - first) / std::max(most, 1);
  for (int c = first; c <= last && !rows_.full(); c += step) {
    // Where the side crosses the row, by Newton's method from its chord.
    double t = (c - side.start_px[major]) / delta_px[major];
    Eigen::Vector2d p = side.pixelAt(t, &derivative);
    t -= (p[major] - c) / derivative[major];
    p = side.pixelAt(t, &derivative);
    if (!(p[minor] > -reach && p[minor] < last_minor + reach)) continue;  // outside the image
    const double outward = (minor == 0 ? derivative.y() : -derivative.x()) / derivative.norm();
    const int low = static_cast<int>(std::ceil(p[minor] - reach));
    const double before = low - p[minor];  // of the first sample, along the row
    // The part of the row that is in the image.
    const double edge_a = (std::max(low, 0) - p[minor]) * outward;
    const double edge_b =
        (std::min(low + static_cast<int>(across) - 1, last_minor) - p[minor]) * outward;
    constexpr double kRounding = 1e-3;
    const auto f = [](double value) { return static_cast<float>(value); };
    const std::size_t row = rows_.add({
        .t = f(t),
        .distance = f(before * outward),
        .step = f(outward),
        .innermost = f(std::max(-window.inner, std::min(edge_a, edge_b) - kRounding)),
        .outermost = f(std::min(window.outer, std::max(edge_a, edge_b) + kRounding)),
        .to_start = f(t * side.length_px * side.sine_start + before * double{rows_.to_start_step}),
        .to_end =
            f((1.0 - t) * side.length_px * side.sine_end + before * double{rows_.to_end_step}),
        .thickness = f(side.thickness_start + t * (side.thickness_end - side.thickness_start)),
        .ring_white = ring == nullptr ? 0.0F : ringWhite(side, *ring, index, t, blur_px),
    });
    for (std::size_t k = 0; k < across; ++k) {
      const int r = std::clamp(low + static_cast<int>(k), 0, last_minor);
      rows_.setGrey(row, k, static_cast<float>(major == 0 ? image.at(c, r) : image.at(r, c)));
    }
  }
  rows_.fillUp();
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
      layOutRows(image, *sides, k, ring, rows, fits[k].blur_px);
      const auto fit = fitEdge(rows_, fits[k], options_.fit);
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
    quad.blur_px += 0.25 * fits[k].blur_px;
  }
  return quad;
}

}  // namespace waymark::slam
