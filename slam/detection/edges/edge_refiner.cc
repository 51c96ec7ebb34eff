#include "slam/detection/edges/edge_refiner.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "base/vectorized.h"
#include "slam/option_checks.h"
namespace waymark::slam {
namespace {

// How far from the side pixels are looked at, and how near its ends, pixels.
struct SideWindow {
  double outer;
  double inner;
  double end_margin;
};

SideWindow windowFor(const MarkerSide& side, double blur_px, bool code_known,
                     const EdgeWindowOptions& options) {
  const double wanted = options.reach_per_blur * blur_px + options.reach_px;
  const double border = std::min(side.thickness_start, side.thickness_end);
  const auto within = [&](double reach, double share) {
    return std::clamp(reach, options.min_reach_px, std::max(options.min_reach_px, share * border));
  };
  const bool sees_behind = static_cast<float>(wanted) >
                           paperAlone(static_cast<float>(border), static_cast<float>(blur_px));
  return {
      within(wanted + (sees_behind ? options.more_outside_px : 0.0), options.max_outside),
      within(wanted, code_known ? options.max_inside : options.max_inside_without_code),
      std::min(options.end_per_blur * blur_px + options.end_px, options.max_end * side.length_px)};
}

// The line of a side moved by its fit: (n, c) with n . p + c = 0, up to scale.
Eigen::Vector3d movedLine(const MarkerSide& side, const EdgeFit& fit) {
  const Eigen::Vector2d a = side.start + side.outward * (fit.shift_start / side.scale_start);
  const Eigen::Vector2d b = side.end + side.outward * (fit.shift_end / side.scale_end);
  const Eigen::Vector2d n(-(b - a).y(), (b - a).x());
  return Eigen::Vector3d(n.x(), n.y(), -n.dot(a)).normalized();
}

struct Corner {
  Eigen::Vector2d normalized;
  Eigen::Matrix2d covariance;
};

// Where the end of side `in` meets the start of side `out`. Empty when they are nearly parallel.
std::optional<Corner> intersect(const MarkerSide& in, const EdgeFit& in_fit, const MarkerSide& out,
                                const EdgeFit& out_fit, const Eigen::Vector2d& side_variance,
                                double systematic_px, const EdgeRefinerOptions& options) {
  Eigen::Matrix2d normals;
  normals.row(0) = in.outward;
  normals.row(1) = out.outward;
  if (!(std::abs(normals.determinant()) > options.min_corner_sine)) return std::nullopt;
  const Eigen::Vector3d meet = movedLine(in, in_fit).cross(movedLine(out, out_fit));
  Corner corner;
  corner.normalized = meet.head<2>() / meet.z();
  if (!corner.normalized.allFinite()) return std::nullopt;
  // A corner moves so that both lines still pass through it: normals * d = (shift in, shift out).
  const Eigen::Matrix2d inverse = normals.inverse();
  const Eigen::Vector2d variance(
      (in_fit.covariance(1, 1) + side_variance[0]) / (in.scale_end * in.scale_end),
      (out_fit.covariance(0, 0) + side_variance[1]) / (out.scale_start * out.scale_start));
  corner.covariance = inverse * variance.asDiagonal() * inverse.transpose();
  const double systematic = systematic_px / in.scale_end;
  corner.covariance.diagonal().array() += systematic * systematic;
  return corner;
}

// Rows of pixels across a side.
struct RowGrid {
  Eigen::Index major;  // axis along which they follow each other; the other is the minor one
  int first;           // the first row's coordinate
  int step;            // from row to row, pixels
  int last_minor;      // of the image
  float before;        // how far from the side along a row, pixels: to its first sample
  float after;         // and to its last
};

WAYMARK_INLINE Lanes polynomial(const std::array<float, 5>& c, const Lanes& t) {
  return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * c[4])));
}
WAYMARK_INLINE Lanes derivativeOf(const std::array<float, 5>& c, const Lanes& t) {
  return c[1] + t * (2.0F * c[2] + t * (3.0F * c[3] + t * (4.0F * c[4])));
}

// Where each row crosses the side, and what follows from that. first_sample: by row, its first
// sample's coordinate on the minor axis.
WAYMARK_VECTORIZED void crossRows(const MarkerSide& side, const SideWindow& window,
                                  const RowGrid& grid, EdgeRows* rows, std::int32_t* first_sample) {
  const auto f = [](double value) { return static_cast<float>(value); };
  std::array<float, 5> along;
  std::array<float, 5> over;
  for (std::size_t k = 0; k < along.size(); ++k) {
    along[k] = f(side.curve_px[k][grid.major]);
    over[k] = f(side.curve_px[k][1 - grid.major]);
  }
  const float per_delta = 1.0F / f((side.end_px - side.start_px)[grid.major]);
  const float outward_sign = grid.major == 1 ? 1.0F : -1.0F;
  const float start_px = f(side.length_px * side.sine_start);
  const float end_px = f(side.length_px * side.sine_end);
  const float outer = f(window.outer);
  const float inner = -f(window.inner);
  const float thickness = f(side.thickness_start);
  const float thickness_slope = f(side.thickness_end - side.thickness_start);
  const auto last_minor = static_cast<float>(grid.last_minor);
  const auto to_last_sample = static_cast<float>(rows->across() - 1);
  constexpr float kRounding = 1e-3F;
  const Lanes none{};
  for (std::size_t i = 0; i < rows->rows(); i += kLanes) {
    Lanes c;
    for (std::size_t k = 0; k < kLanes; ++k) {
      c[k] = static_cast<float>(grid.first + static_cast<int>(i + k) * grid.step);
    }
    // By Newton's method from the chord.
    Lanes t = (c - along[0]) * per_delta;
    t -= (polynomial(along, t) - c) / derivativeOf(along, t);
    const Lanes p = polynomial(over, t);
    const Lanes d_along = derivativeOf(along, t);
    const Lanes d_over = derivativeOf(over, t);
    const Lanes squared = d_along * d_along + d_over * d_over;
    Lanes norm;
    for (std::size_t k = 0; k < kLanes; ++k) norm[k] = std::sqrt(squared[k]);
    const Lanes outward = outward_sign * d_along / norm;
    // False for a NaN. Rows that cross the side outside the image have nothing of it.
    const IntLanes crosses = (p > -grid.after) & (p < last_minor + grid.before);
    const Lanes lowest = crosses ? p - grid.before : none;
    IntLanes low = __builtin_convertvector(lowest, IntLanes);  // towards zero
    low -= __builtin_convertvector(low, Lanes) < lowest;       // true is -1
    const Lanes first = __builtin_convertvector(low, Lanes);
    const Lanes last = first + to_last_sample;
    const Lanes before = first - p;
    const Lanes one_end = ((first > 0.0F ? first : none) - p) * outward;
    const Lanes other_end = ((last < last_minor ? last : none + last_minor) - p) * outward;
    const Lanes nearest = (one_end < other_end ? one_end : other_end) - kRounding;
    const Lanes farthest = (one_end < other_end ? other_end : one_end) + kRounding;
    lanesAt(rows->t.data(), i) = t;
    lanesAt(rows->distance.data(), i) = before * outward;
    lanesAt(rows->step.data(), i) = outward;
    lanesAt(rows->innermost.data(), i) =
        crosses ? (nearest > inner ? nearest : none + inner) : none + 1.0F;
    lanesAt(rows->outermost.data(), i) =
        crosses ? (farthest < outer ? farthest : none + outer) : none - 1.0F;
    lanesAt(rows->to_start.data(), i) = t * start_px + before * rows->to_start_step;
    lanesAt(rows->to_end.data(), i) = (1.0F - t) * end_px + before * rows->to_end_step;
    lanesAt(rows->thickness.data(), i) = thickness + t * thickness_slope;
    for (std::size_t k = 0; k < kLanes; ++k) first_sample[i + k] = low[k];
  }
}

// How white each row finds the cells behind the border, blurred along them. slant: how far along
// the side one sample is from the next, a share of its length. Rows need not be at right angles to
// the side: they reach the cells further along it, or less far, than where they cross it.
WAYMARK_VECTORIZED void reachCells(const MarkerSide& side, const InnerRing& ring, std::size_t index,
                                   float slant, double blur_px, EdgeRows* rows) {
  const auto cells = static_cast<float>(side.cells);
  const auto perspective = static_cast<float>(side.perspective);
  const auto blurs = static_cast<float>(side.length_px / (side.cells * side.perspective * blur_px));
  const Lanes none{};
  for (std::size_t i = 0; i < rows->rows(); i += kLanes) {
    const Lanes samples = lanesAt(rows->thickness.data(), i) / lanesAt(rows->step.data(), i);
    const Lanes t = lanesAt(rows->t.data(), i) - samples * slant;
    const Lanes d = t + perspective * (1.0F - t);
    const Lanes u = cells * t / d;  // MarkerSide::printCoordinate()
    const Lanes per_cell = d * d * blurs;
    Lanes white{};
    for (int boundary = 1; boundary <= ring.cells_per_side + 1; ++boundary) {
      const float change = ring.cell(index, boundary) - ring.cell(index, boundary - 1);
      if (change == 0.0F) continue;
      const Lanes beyond = (u - static_cast<float>(boundary)) * per_cell;
      BlurredStep<Lanes> step;
      blurredStepAt(beyond, &step);
      white += beyond > -kBlurReach ? change * step.height : none;
    }
    lanesAt(rows->ring_white.data(), i) = white;
  }
}

// What lies beyond 0 .. last goes to the nearer end, however far away it is.
int inRange(double value, int last) {
  if (!(value > 0.0)) return 0;
  return value < last ? static_cast<int>(value) : last;
}

// Residuals of a fit outside of its edge: in the nearer and in the farther half of what is `far`
// away, pixels. Sums, and of how many.
struct Bands {
  float far = 0.0F;
  float near_sum = 0.0F, near_count = 0.0F, far_sum = 0.0F, far_count = 0.0F;
};

WAYMARK_VECTORIZED void sumBands(const EdgeRows& rows, const EdgeFit& fit, Bands* bands) {
  const auto f = [](double value) { return static_cast<float>(value); };
  const float white = f(fit.white);
  const float contrast = f(fit.white - fit.black);
  const float behind = f(fit.behind);
  const float margin = f(fit.margin_px);
  const float per_blur = 1.0F / f(fit.blur_px);
  const float start = f(fit.shift_start);
  const float slope = f(fit.shift_end - fit.shift_start);
  const float near_from = 0.5F * bands->far;
  const Lanes none{};
  Lanes near_sum{};
  Lanes near_count{};
  Lanes far_sum{};
  Lanes far_count{};
  for (std::size_t i = 0; i < rows.rows(); i += kLanes) {
    const Lanes innermost = lanesAt(rows.innermost.data(), i);
    const Lanes outermost = lanesAt(rows.outermost.data(), i);
    const Lanes shift = start + slope * lanesAt(rows.t.data(), i);
    const float* const grey = rows.grey(i);
    Lanes distance = lanesAt(rows.distance.data(), i);
    for (std::size_t k = 0; k < rows.across(); ++k) {
      const Lanes outside = distance - shift;
      BlurredStep<Lanes> edge;
      blurredStepAt(-outside * per_blur, &edge);
      const Lanes paper = white - contrast * edge.height;
      blurredStepAt((outside - margin - lanesAt(rows.thickness.data(), i)) * per_blur, &edge);
      const Lanes residual = lanesAt(grey, k * kLanes) - paper - behind * edge.height;
      const IntLanes counts = (distance >= innermost) & (distance <= outermost);
      const IntLanes far = counts & (outside >= bands->far);
      const IntLanes near = counts & (outside >= near_from) & (outside < bands->far);
      near_sum += near ? residual : none;
      near_count += near ? none + 1.0F : none;
      far_sum += far ? residual : none;
      far_count += far ? none + 1.0F : none;
      distance += lanesAt(rows.step.data(), i);
    }
  }
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    bands->near_sum += near_sum[lane];
    bands->near_count += near_count[lane];
    bands->far_sum += far_sum[lane];
    bands->far_count += far_count[lane];
  }
}

// The variance of a side by what is behind the paper, pixels squared.
double marginVariance(const EdgeRows& rows, const EdgeFit& fit, const EdgeRefinerOptions& options) {
  Bands bands{.far = static_cast<float>(options.margin_far * fit.blur_px)};
  sumBands(rows, fit, &bands);
  if (bands.near_count == 0.0F || bands.far_count == 0.0F) return 0.0;
  const double darker = double{bands.near_sum} / double{bands.near_count} -
                        double{bands.far_sum} / double{bands.far_count};
  const double variance =
      fit.variance * (1.0 / double{bands.near_count} + 1.0 / double{bands.far_count});
  if (darker < 0.0 || darker * darker < options.margin_chi2 * variance) return 0.0;
  const double sigma_px = options.margin_sigma * darker / (fit.white - fit.black) * fit.blur_px;
  return sigma_px * sigma_px;
}

// What is not in the variance of a side's fit, pixels squared.
double narrowVariance(const EdgeFit& fit, const MarkerSide& side,
                      const EdgeRefinerOptions& options) {
  const double thickness = std::min(side.thickness_start, side.thickness_end);
  const double narrow = std::max(fit.blur_px / thickness - options.narrow_border, 0.0);
  const double by_cells = options.narrow_border_sigma * narrow * fit.blur_px;
  const double beyond_px = std::max(options.window.min_reach_px - thickness, 0.0);
  const double by_window = options.beyond_border_sigma * beyond_px;
  return by_cells * by_cells + by_window * by_window;
}

constexpr double kGrownBlur = 1.25;

double largestShift(const EdgeFit& fit) {
  return std::max(std::abs(fit.shift_start), std::abs(fit.shift_end));
}

bool isBent(const EdgeFit& fit, const EdgeRefinerOptions& options) {
  return std::abs(fit.bow_px) > options.min_bow_px &&
         fit.bow_px * fit.bow_px > options.bow_chi2 * fit.bow_variance;
}

}  // namespace

std::string EdgeWindowOptions::invalidReason() const {
  return firstUnmet({
      {isNotNegative(reach_per_blur) && isNotNegative(reach_px) && isPositive(min_reach_px) &&
           isNotNegative(more_outside_px),
       "the reach of a side's window must be positive"},
      {isPositive(max_outside) && isPositive(max_inside) && isPositive(max_inside_without_code),
       "the shares of a border that a side's window may take must be positive"},
      {isNotNegative(end_per_blur) && isNotNegative(end_px),
       "what a side's window leaves out at the ends must not be negative"},
      {max_end >= 0.0 && max_end < 0.5, "a side's window must leave out less than all of it"},
  });
}

std::string EdgeRefinerOptions::invalidReason() const {
  return firstReason({
      fit.invalidReason(),
      window.invalidReason(),
      firstUnmet({
          {isPositive(initial_blur_px), "the blur to start from must be positive"},
          {rows_rough >= 1 && rows_fine >= 1, "a side needs at least 1 row of pixels"},
          {isNotNegative(settled_shift_px), "the shift of a settled side must not be negative"},
          {passes >= 1, "a side needs at least 1 fit"},
          {isNotNegative(bow_chi2) && isNotNegative(min_bow_px) && isNotNegative(bow_share),
           "chi-square, size and share of a side's bow must not be negative"},
          {isNotNegative(soft_blur_px) && isNotNegative(narrow_border) &&
               isNotNegative(narrow_border_sigma) && isNotNegative(beyond_border_sigma),
           "blur, share and sigmas of a narrow border must not be negative"},
          {isNotNegative(margin_chi2) && isPositive(margin_far) && isNotNegative(margin_sigma),
           "what tells of a narrow margin must not be negative"},
          {bent_passes >= 0, "the fits of a bent side must not be negative"},
          {isNotNegative(systematic_sigma_px), "the systematic sigma must not be negative"},
          {min_corner_sine >= 0.0 && min_corner_sine < 1.0,
           "the least sine of a corner's angle must be from 0 to less than 1"},
      }),
  });
}

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

void EdgeRefiner::layOutRows(const PlacedImage& placed, const std::array<MarkerSide, 4>& sides,
                             std::size_t index, const InnerRing* ring, int max_rows,
                             double blur_px) {
  const ImageView& image = placed.image;
  const MarkerSide& side = sides[index];
  const SideWindow window = windowFor(side, blur_px, ring != nullptr, options_.window);
  // Rows follow each other along the side's longer axis, and cross it along the other.
  const Eigen::Vector2d delta_px = side.end_px - side.start_px;
  const Eigen::Index major = std::abs(delta_px.x()) >= std::abs(delta_px.y()) ? 0 : 1;
  const Eigen::Index minor = 1 - major;
  const int last_major = (major == 0 ? image.width : image.height) - 1;
  const int last_minor = (major == 0 ? image.height : image.width) - 1;
  const double slant = side.length_px / std::abs(delta_px[major]);
  const bool outwards = (delta_px[major] > 0.0) == (major == 1);  // from sample to sample
  const double before = slant * (outwards ? window.inner : window.outer);
  const double after = slant * (outwards ? window.outer : window.inner);
  const auto across = std::min(static_cast<std::size_t>(before + after) + 1, EdgeRows::kMaxAcross);

  const double margin_t = window.end_margin / side.length_px;
  const double from = side.pixelAt(margin_t)[major];
  const double to = side.pixelAt(1.0 - margin_t)[major];
  const int first = inRange(std::ceil(std::min(from, to)), last_major);
  const int last = inRange(std::floor(std::max(from, to)), last_major);
  const int most = std::min(max_rows, static_cast<int>(EdgeRows::kMaxRows));
  const int step = 1 + (last - first) / std::max(most, 1);
  const int count = last < first ? 0 : (last - first) / step + 1;
  rows_.resize(static_cast<std::size_t>(count), across);
  const auto inwards = [&](const MarkerSide& neighbour) {  // per pixel of a row
    const Eigen::Vector2d along = (neighbour.end_px - neighbour.start_px).normalized();
    return static_cast<float>(minor == 0 ? -along.y() : along.x());
  };
  rows_.to_start_step = inwards(sides[(index + 3) % 4]);
  rows_.to_end_step = inwards(sides[(index + 1) % 4]);
  crossRows(side, window,
            {major, first, step, last_minor, static_cast<float>(before), static_cast<float>(after)},
            &rows_, first_sample_.data());

  if (ring != nullptr) {
    const double along = delta_px[minor] / (side.length_px * side.length_px);
    reachCells(side, *ring, index, static_cast<float>(along), blur_px, &rows_);
  } else {
    rows_.ring_white.fill(0.0F);
  }
  rows_.ignorePadding();
  for (std::size_t row = 0; row < static_cast<std::size_t>(count); ++row) {
    const int c = first + static_cast<int>(row) * step;
    const int low = first_sample_[row];
    const auto greyAt = [&](int r) {
      return static_cast<float>(major == 0 ? image.at(c, r) : image.at(r, c));
    };
    if (low >= 0 && low + static_cast<int>(across) - 1 <= last_minor) {
      for (std::size_t k = 0; k < across; ++k) {
        rows_.setGrey(row, k, greyAt(low + static_cast<int>(k)));
      }
    } else {
      for (std::size_t k = 0; k < across; ++k) {
        rows_.setGrey(row, k, greyAt(std::clamp(low + static_cast<int>(k), 0, last_minor)));
      }
    }
  }
}

std::optional<RefinedQuad> EdgeRefiner::refine(const PlacedImage& placed,
                                               const std::array<Eigen::Vector2d, 4>& corners,
                                               int cells, const InnerRing* ring,
                                               const SideFits* edges) {
  RefinedQuad quad;
  quad.normalized = corners;
  if (edges != nullptr) {
    quad.edges = *edges;
    // A wrong idea of what is behind the paper would go on from frame to frame.
    for (EdgeFit& fit : quad.edges) fit.behind = fit.margin_px = 0.0;
  } else {
    for (EdgeFit& fit : quad.edges) fit.blur_px = options_.initial_blur_px;
  }

  const bool rough_first = ring != nullptr && edges == nullptr;
  SideShapes shapes;
  bool settled = false;
  for (int pass = rough_first ? -1 : 0; pass < shapes.passes(options_) && !settled; ++pass) {
    auto sides = layOutSides(camera_, quad.normalized, cells);
    if (!sides) return std::nullopt;
    for (std::size_t k = 0; k < 4; ++k) {
      (*sides)[k].placeIn(placed);
      if (shapes.bow_px[k] != 0.0) (*sides)[k].bend(shapes.bow_px[k]);
    }
    const int rows = pass < 0 || ring == nullptr ? options_.rows_rough : options_.rows_fine;
    const bool is_last = pass + 1 >= shapes.passes(options_);
    const double enough_px =
        is_last ? std::numeric_limits<double>::infinity() : options_.settled_shift_px;
    settled = pass >= 0;
    for (std::size_t k = 0; k < 4; ++k) {
      EdgeFit& fit = quad.edges[k];
      const double blur_px = fit.blur_px;
      fit.shift_start = fit.shift_end = 0.0;
      layOutRows(placed, *sides, k, ring, rows, blur_px);
      const auto fitted = fitEdge(rows_, fit, options_.fit, enough_px);
      if (!fitted) return std::nullopt;
      fit = *fitted;
      // A window for less blur than there is sees too little of the edge.
      const bool is_near = largestShift(fit) < options_.settled_shift_px;
      settled = settled && is_near && fit.blur_px < kGrownBlur * blur_px;
      if (pass < 0 || ring == nullptr) continue;
      shapes.narrow_variance[k] = narrowVariance(fit, (*sides)[k], options_);
      if (isSoft(fit.blur_px, placed)) {
        shapes.narrow_variance[k] += marginVariance(rows_, fit, options_);
      }
      if (!(is_near || is_last) || !isBent(fit, options_)) continue;
      shapes.bow_px[k] += fit.bow_px;
      settled = false;
    }
    if (!meetSides(*sides, shapes, &quad)) return std::nullopt;
  }
  for (std::size_t k = 0; k < 4; ++k) {
    quad.pixels[k] = camera_.distort(quad.normalized[k]);
    quad.edges[k].bow_px = shapes.bow_px[k];
  }
  return quad;
}

bool EdgeRefiner::meetSides(const std::array<MarkerSide, 4>& sides, const SideShapes& shapes,
                            RefinedQuad* quad) const {
  const double systematic_px =
      std::hypot(options_.systematic_sigma_px, options_.bow_share * shapes.largestBow_px());
  const auto variance = [&](std::size_t k, Eigen::Index end) {
    const double by_bow = shapes.bow_px[k] == 0.0 ? 0.0 : quad->edges[k].bent_variance[end];
    return shapes.narrow_variance[k] + by_bow;
  };
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t before = (k + 3) % 4;
    const auto corner = intersect(sides[before], quad->edges[before], sides[k], quad->edges[k],
                                  {variance(before, 1), variance(k, 0)}, systematic_px, options_);
    if (!corner) return false;
    quad->normalized[k] = corner->normalized;
    quad->covariance[k] = corner->covariance;
  }
  return true;
}

double EdgeRefiner::SideShapes::largestBow_px() const {
  double largest = 0.0;
  for (const double bow : bow_px) largest = std::max(largest, std::abs(bow));
  return largest;
}

int EdgeRefiner::SideShapes::passes(const EdgeRefinerOptions& options) const {
  return options.passes + (largestBow_px() > 0.0 ? options.bent_passes : 0);
}

}  // namespace waymark::slam
