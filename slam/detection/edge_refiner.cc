#include "slam/detection/edge_refiner.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/homography.h"

namespace waymark::slam {
namespace {

// The Gaussian's distribution function, tabulated: it is needed some thousand times per marker.
class GaussTable {
 public:
  GaussTable() {
    for (int i = 0; i < kSize; ++i) {
      const double x = -kRange + i / kPerUnit;
      cdf_[static_cast<std::size_t>(i)] = static_cast<float>(0.5 * std::erfc(-x / std::sqrt(2.0)));
    }
  }
  [[nodiscard]] float cdf(float x) const {
    const float position = (x + kRange) * kPerUnit;
    if (!(position > 0.0F)) return 0.0F;
    if (position >= kSize - 1.0F) return 1.0F;
    const auto i = static_cast<std::size_t>(position);
    const float f = position - static_cast<float>(i);
    return cdf_[i] + f * (cdf_[i + 1] - cdf_[i]);
  }
  // Density; exp() once per pixel is cheap enough and exact.
  [[nodiscard]] static float pdf(float x) { return 0.39894228F * std::exp(-0.5F * x * x); }

 private:
  static constexpr float kRange = 5.0F;
  static constexpr float kPerUnit = 128.0F;
  static constexpr int kSize = 1281;
  std::array<float, kSize> cdf_{};
};

const GaussTable& gauss() {
  static const GaussTable table;
  return table;
}

// One pixel near a side.
struct Sample {
  float distance;    // from the side as laid out, outwards, pixels
  float t;           // along it, 0 at its first corner, 1 at its second
  float to_start;    // distance from the side before, pixels
  float to_end;      // distance from the side after, pixels
  float thickness;   // of the black border here, pixels
  float ring_white;  // how white the code cell behind the border is, 0 .. 1
  float grey;
};

constexpr std::size_t kMaxSamples = 2048;
constexpr int kParameters =
    7;  // shift at start, at end, white, black, blur, slopes of white, black
using VectorPd = Eigen::Matrix<double, kParameters, 1>;
using MatrixPd = Eigen::Matrix<double, kParameters, kParameters>;

// How dark the model is at a sample (1 = border's grey level, 0 = surroundings') and its
// derivatives.
struct Darkness {
  float value;
  float by_shift;
  float by_blur;
};

Darkness darknessAt(const Sample& s, float shift, float blur) {
  const float x = (s.distance - shift) / blur;
  const float ends = gauss().cdf(s.to_start / blur) * gauss().cdf(s.to_end / blur);
  const float ring = 1.0F - s.ring_white * gauss().cdf(-(s.distance + s.thickness) / blur);
  const float factor = ends * ring;
  const float slope = GaussTable::pdf(x) / blur * factor;
  return {gauss().cdf(-x) * factor, slope, slope * x};
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

// A side as laid out from the current corners.
struct EdgeRefiner::Side {
  Eigen::Vector2d start, end;        // normalised
  Eigen::Vector2d start_px, end_px;  // distorted
  Eigen::Vector2d bulge_px;          // lens curvature: offset of the middle from the chord
  Eigen::Vector2d along, outward;    // unit vectors, normalised coordinates
  double length = 0.0;               // normalised
  double length_px = 0.0;
  double scale_start = 0.0, scale_end = 0.0;          // pixels per normalised unit across the side
  double thickness_start = 0.0, thickness_end = 0.0;  // of the border, pixels
  double sine_start = 0.0, sine_end = 0.0;  // of the angle between this side and its neighbours
  double perspective = 0.0;  // u(t) = t / (t + perspective * (1 - t)), in print coordinates
  int cells = 0;
};

struct EdgeRefiner::SideFit {
  double shift_start = 0.0, shift_end = 0.0;  // outwards, pixels
  double white = 0.0, black = 0.0;
  double blur = 0.0;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of the two shifts, pixels squared
};

EdgeRefiner::EdgeRefiner(const CameraModel& camera, const UndistortionTable& table,
                         const EdgeRefinerOptions& options)
    : camera_(camera), table_(table), options_(options) {}

std::optional<std::array<EdgeRefiner::Side, 4>> EdgeRefiner::layOut(
    const std::array<Eigen::Vector2d, 4>& normalised, int cells) const {
  const auto H = homographyFromUnitSquare(normalised);
  if (!H) return std::nullopt;
  const double border = 1.0 / cells;
  std::array<Side, 4> sides;
  for (std::size_t k = 0; k < 4; ++k) {
    Side& side = sides[k];
    side.start = normalised[k];
    side.end = normalised[(k + 1) % 4];
    side.cells = cells;
    side.length = (side.end - side.start).norm();
    if (!(side.length > 0.0)) return std::nullopt;
    side.along = (side.end - side.start) / side.length;
    side.outward = {side.along.y(), -side.along.x()};

    Eigen::Matrix2d J_start;
    Eigen::Matrix2d J_end;
    side.start_px = camera_.distort(side.start, &J_start);
    side.end_px = camera_.distort(side.end, &J_end);
    side.length_px = (side.end_px - side.start_px).norm();
    side.bulge_px =
        camera_.distort(0.5 * (side.start + side.end)) - 0.5 * (side.start_px + side.end_px);
    // A line moved by d in normalised units moves by d / |J^-T outward| pixels across itself.
    side.scale_start = 1.0 / (J_start.inverse().transpose() * side.outward).norm();
    side.scale_end = 1.0 / (J_end.inverse().transpose() * side.outward).norm();
  }

  // The print's corners in the unit square, to find the inner line of the border.
  const std::array<Eigen::Vector2d, 4> unit = {Eigen::Vector2d(0, 0), Eigen::Vector2d(1, 0),
                                               Eigen::Vector2d(1, 1), Eigen::Vector2d(0, 1)};
  for (std::size_t k = 0; k < 4; ++k) {
    Side& side = sides[k];
    const Eigen::Vector2d a = unit[k];
    const Eigen::Vector2d b = unit[(k + 1) % 4];
    const Eigen::Vector2d inward(-(b - a).y(), (b - a).x());
    const Eigen::Vector2d inner_a = applyHomography(*H, a + border * (b - a) + border * inward);
    const Eigen::Vector2d inner_b = applyHomography(*H, b - border * (b - a) + border * inward);
    const double t_a = (inner_a - side.start).dot(side.along) / side.length;
    const double t_b = (inner_b - side.start).dot(side.along) / side.length;
    const double m_a = -(inner_a - side.start).dot(side.outward);
    const double m_b = -(inner_b - side.start).dot(side.outward);
    if (!(t_b > t_a)) return std::nullopt;
    const double slope = (m_b - m_a) / (t_b - t_a);
    side.thickness_start = (m_a - slope * t_a) * side.scale_start;
    side.thickness_end = (m_a + slope * (1.0 - t_a)) * side.scale_end;
    if (!(side.thickness_start > 0.0) || !(side.thickness_end > 0.0)) return std::nullopt;

    const Side& before = sides[(k + 3) % 4];
    const Side& after = sides[(k + 1) % 4];
    side.sine_start =
        std::abs(side.along.x() * before.along.y() - side.along.y() * before.along.x());
    side.sine_end = std::abs(side.along.x() * after.along.y() - side.along.y() * after.along.x());

    // Where the print's middle of this side falls gives the perspective along it.
    const Eigen::Vector2d middle = applyHomography(*H, 0.5 * (a + b));
    const double t_middle =
        std::clamp((middle - side.start).dot(side.along) / side.length, 0.05, 0.95);
    side.perspective = t_middle / (1.0 - t_middle);
  }
  return sides;
}

std::optional<EdgeRefiner::SideFit> EdgeRefiner::fitSide(const ImageView& image, const Side& side,
                                                         const InnerRing* ring, int index,
                                                         const SideFit& start) const {
  const double thinnest = std::min(side.thickness_start, side.thickness_end);
  const double wanted = 2.5 * start.blur + 0.7;
  const double outer = std::clamp(wanted, 1.5, std::max(1.5, 0.9 * thinnest));
  const double inner =
      std::clamp(wanted, 1.5, std::max(1.5, (ring != nullptr ? 1.0 : 0.6) * thinnest));
  const double end_margin_px = std::min(1.2 * start.blur + 0.5, 0.25 * side.length_px);

  // Collect the pixels near the side, walking along its longer axis.
  std::array<Sample, kMaxSamples> samples;  // NOLINT(cppcoreguidelines-pro-type-member-init)
  std::size_t count = 0;
  const Eigen::Vector2d delta_px = side.end_px - side.start_px;
  const int major = std::abs(delta_px.x()) >= std::abs(delta_px.y()) ? 0 : 1;
  const int minor = 1 - major;
  const double reach = std::max(outer, inner) * side.length_px / std::abs(delta_px[major]);
  const double first = std::min(side.start_px[major], side.end_px[major]);
  const double last = std::max(side.start_px[major], side.end_px[major]);
  const int columns = static_cast<int>(last - first) + 1;
  const int per_column = 2 * static_cast<int>(reach) + 2;
  const int rows = std::min(ring != nullptr ? options_.rows_fine : options_.rows_rough,
                            static_cast<int>(kMaxSamples) / per_column);
  const int step = 1 + (columns - 1) / std::max(rows, 1);
  const int limit[2] = {image.width - 1, image.height - 1};
  for (int c = static_cast<int>(std::ceil(first)); c <= static_cast<int>(last); c += step) {
    if (c < 0 || c > limit[major]) continue;
    const double chord = (c - side.start_px[major]) / delta_px[major];
    const double centre = side.start_px[minor] + chord * delta_px[minor] +
                          4.0 * chord * (1.0 - chord) * side.bulge_px[minor];
    const int low = std::max(0, static_cast<int>(std::ceil(centre - reach)));
    const int high = std::min(limit[minor], static_cast<int>(std::floor(centre + reach)));
    for (int r = low; r <= high && count < kMaxSamples; ++r) {
      const int x = major == 0 ? c : r;
      const int y = major == 0 ? r : c;
      const Eigen::Vector2d offset = table_.at(x, y).cast<double>() - side.start;
      const double t = offset.dot(side.along) / side.length;
      const double from_start = t * side.length_px;
      const double from_end = (1.0 - t) * side.length_px;
      if (!(from_start >= end_margin_px) || !(from_end >= end_margin_px)) continue;
      const double scale = side.scale_start + t * (side.scale_end - side.scale_start);
      const double distance = offset.dot(side.outward) * scale;
      if (distance > outer || distance < -inner) continue;
      Sample& s = samples[count++];
      s.distance = static_cast<float>(distance);
      s.t = static_cast<float>(t);
      s.to_start = static_cast<float>(from_start * side.sine_start);
      s.to_end = static_cast<float>(from_end * side.sine_end);
      s.thickness = static_cast<float>(side.thickness_start +
                                       t * (side.thickness_end - side.thickness_start));
      s.ring_white = 0.0F;
      s.grey = static_cast<float>(image.at(x, y));
      if (ring != nullptr) {
        // Print coordinate along the side, in cells, and the blurred whiteness of the ring there.
        const double u = side.cells * t / (t + side.perspective * (1.0 - t));
        const double du_dt =
            side.cells * side.perspective / std::pow(t + side.perspective * (1.0 - t), 2);
        const double px_per_cell = side.length_px / du_dt;
        const auto white = [&](int cell) {
          return cell >= 0 && cell < ring->cells_per_side &&
                         ((ring->white[static_cast<std::size_t>(index)] >> cell) & 1U) != 0
                     ? 1.0F
                     : 0.0F;
        };
        const double boundary = std::round(u);
        const int right = static_cast<int>(boundary) - 1;
        const auto blend =
            gauss().cdf(static_cast<float>((u - boundary) * px_per_cell / start.blur));
        s.ring_white = white(right - 1) + blend * (white(right) - white(right - 1));
      }
    }
  }
  constexpr std::size_t kFewest = 16;
  if (count < kFewest) return std::nullopt;

  constexpr double kConverged = 0.003;  // pixels
  // Gauss-Newton. The grey levels' slopes and the blur are held by weak priors.
  const double prior_slope = 1.0 / (10.0 * 10.0);
  const double prior_blur = 1.0 / (0.5 * 0.5);
  VectorPd x;
  x << start.shift_start, start.shift_end, start.white, start.black, start.blur, 0.0, 0.0;
  MatrixPd H;
  double variance = 0.0;
  for (int iteration = 0; iteration < options_.iterations; ++iteration) {
    H.setZero();
    VectorPd g = VectorPd::Zero();
    double sum = 0.0;
    double weights = 0.0;
    const double cut = iteration == 0 ? 1e9 : 9.0 * std::max(variance, 1.0);
    for (std::size_t i = 0; i < count; ++i) {
      const Sample& s = samples[i];
      const double t = s.t;
      const double shift = x[0] + t * (x[1] - x[0]);
      const Darkness dark = darknessAt(s, static_cast<float>(shift), static_cast<float>(x[4]));
      const double white = x[2] + x[5] * (t - 0.5);
      const double black = x[3] + x[6] * (t - 0.5);
      const double model = white + (black - white) * dark.value;
      const double residual = model - s.grey;
      const double contrast = black - white;
      VectorPd J;
      J << contrast * dark.by_shift * (1.0 - t), contrast * dark.by_shift * t, 1.0 - dark.value,
          dark.value, contrast * dark.by_blur, (1.0 - dark.value) * (t - 0.5),
          dark.value * (t - 0.5);
      const double weight = 1.0 / (1.0 + residual * residual / cut);
      H.selfadjointView<Eigen::Lower>().rankUpdate(J, weight);
      g += weight * residual * J;
      sum += weight * residual * residual;
      weights += weight;
    }
    // In units of the residuals' variance, so that priors weigh against noise.
    variance = std::max(sum / std::max(weights - kParameters, 1.0), 0.25);
    H(4, 4) += prior_blur * variance;
    g[4] += prior_blur * variance * (x[4] - start.blur);
    for (const int k : {5, 6}) {
      H(k, k) += prior_slope * variance;
      g[k] += prior_slope * variance * x[k];
    }
    const Eigen::LDLT<MatrixPd> factor(H.selfadjointView<Eigen::Lower>());
    VectorPd update = factor.solve(g);
    if (!update.allFinite()) return std::nullopt;
    update[0] = std::clamp(update[0], -1.5, 1.5);
    update[1] = std::clamp(update[1], -1.5, 1.5);
    x -= update;
    const bool converged = std::max(std::abs(update[0]), std::abs(update[1])) < kConverged;
    x[4] = std::clamp(x[4], options_.min_blur_px, options_.max_blur_px);
    if (std::abs(x[0]) > options_.max_shift_px || std::abs(x[1]) > options_.max_shift_px) {
      return std::nullopt;
    }
    if (converged && iteration > 0) break;
  }
  if (x[2] - x[3] < options_.min_contrast) return std::nullopt;
  SideFit fit;
  fit.shift_start = x[0];
  fit.shift_end = x[1];
  fit.white = x[2];
  fit.black = x[3];
  fit.blur = x[4];
  const MatrixPd inverse =
      Eigen::LDLT<MatrixPd>(H.selfadjointView<Eigen::Lower>()).solve(MatrixPd::Identity());
  fit.covariance = variance * inverse.topLeftCorner<2, 2>();
  return fit;
}

std::optional<RefinedQuad> EdgeRefiner::refine(const ImageView& image,
                                               const std::array<Eigen::Vector2d, 4>& corners_px,
                                               int cells, const InnerRing* ring) const {
  std::array<Eigen::Vector2d, 4> corners;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto n = camera_.undistort(corners_px[k]);
    if (!n) return std::nullopt;
    corners[k] = *n;
  }
  SideFit guess;
  guess.blur = options_.initial_blur_px;
  guess.white = 180.0;
  guess.black = 50.0;
  std::array<SideFit, 4> fits;
  fits.fill(guess);
  RefinedQuad result;
  constexpr int kPasses = 2;  // the second one lays the window around the edge just found
  for (int pass = 0; pass < kPasses; ++pass) {
    const auto sides = layOut(corners, cells);
    if (!sides) return std::nullopt;
    for (std::size_t k = 0; k < 4; ++k) {
      fits[k].shift_start = 0.0;
      fits[k].shift_end = 0.0;
      const auto fit = fitSide(image, (*sides)[k], ring, static_cast<int>(k), fits[k]);
      if (!fit) return std::nullopt;
      fits[k] = *fit;
    }

    // Lines through the moved end points; corner k lies between sides k - 1 and k.
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t j = (k + 3) % 4;
      const Side& in = (*sides)[j];
      const Side& out = (*sides)[k];
      // Each line, moved by its shift at this corner, and turned by the difference of its shifts.
      const auto line = [](const Side& side, const SideFit& fit) {
        const Eigen::Vector2d a = side.start + side.outward * (fit.shift_start / side.scale_start);
        const Eigen::Vector2d b = side.end + side.outward * (fit.shift_end / side.scale_end);
        const Eigen::Vector2d n(-(b - a).y(), (b - a).x());
        return Eigen::Vector3d(n.x(), n.y(), -n.dot(a)).normalized().eval();
      };
      const Eigen::Vector3d meet = line(in, fits[j]).cross(line(out, fits[k]));
      corners[k] = meet.head<2>() / meet.z();
      if (!corners[k].allFinite()) return std::nullopt;

      Eigen::Matrix2d N;
      N.row(0) = in.outward;
      N.row(1) = out.outward;
      if (!(std::abs(N.determinant()) > 0.05)) return std::nullopt;
      const Eigen::Matrix2d inverse = N.inverse();
      Eigen::Vector2d variance(fits[j].covariance(1, 1) / (in.scale_end * in.scale_end),
                               fits[k].covariance(0, 0) / (out.scale_start * out.scale_start));
      result.covariance[k] = inverse * variance.asDiagonal() * inverse.transpose();
      const double floor = options_.systematic_sigma_px / in.scale_end;
      result.covariance[k].diagonal().array() += floor * floor;
    }
  }
  result.normalised = corners;
  for (std::size_t k = 0; k < 4; ++k) {
    result.pixels[k] = camera_.distort(corners[k]);
    result.black += 0.25 * fits[k].black;
    result.white += 0.25 * fits[k].white;
    result.blur_px += 0.25 * fits[k].blur;
  }
  return result;
}

}  // namespace waymark::slam
