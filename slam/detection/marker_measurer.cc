#include "slam/detection/marker_measurer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Geometry>

#include "slam/detection/search/window.h"
#include "slam/geometry/plane.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

double meanOf(const SideFits& edges, double EdgeFit::*value) {
  double sum = 0.0;
  for (const EdgeFit& edge : edges) sum += edge.*value;
  return 0.25 * sum;
}

// As they look in an image of twice the size, if the sensor's noise is all there is.
SideFits atTwiceTheSize(SideFits edges) {
  for (EdgeFit& edge : edges) {
    edge.blur_px *= 2.0;
    edge.variance *= 4.0;
  }
  return edges;
}

// Square root of the area, pixels.
double sizeOf(const std::array<Eigen::Vector2d, 4>& pixels) {
  return std::sqrt(0.5 * std::abs(cross(pixels[2] - pixels[0], pixels[3] - pixels[1])));
}

// Where straight sides would meet that follow curved ones as well as they can: the cells of a bent
// print are nearer to theirs. Normalized; the quad's corners where all sides are straight.
std::array<Eigen::Vector2d, 4> straightened(const RefinedQuad& quad, const CameraModel& camera,
                                            int factor) {
  const bool is_straight =
      std::ranges::all_of(quad.edges, [](const EdgeFit& edge) { return edge.bow_px == 0.0; });
  if (is_straight) return quad.normalized;
  std::array<Eigen::Vector3d, 4> lines;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d along = (quad.pixels[(k + 1) % 4] - quad.pixels[k]).normalized();
    const Eigen::Vector2d outward(along.y(), -along.x());
    // The mean of a parabola is at two thirds of its height.
    const double shift = 2.0 / 3.0 * factor * quad.edges[k].bow_px;
    lines[k] << outward, -outward.dot(quad.pixels[k]) - shift;
  }
  std::array<Eigen::Vector2d, 4> corners;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d meet = lines[(k + 3) % 4].cross(lines[k]);
    const auto normalized = camera.undistort(meet.head<2>() / meet.z());
    if (!normalized) return quad.normalized;
    corners[k] = *normalized;
  }
  return corners;
}

}  // namespace

std::string SoftEdgeOptions::invalidReason() const {
  return firstUnmet({
      {max_factor == 1 || max_factor == 2 || max_factor == 4,
       "soft edges can be fitted at 1, 1/2 or 1/4 of the size"},
      {isPositive(min_cell_px), "the least size of a soft marker's cell must be positive"},
      {isShare(max_step), "the step of a soft edge must be from 0 to 1"},
      {step_px >= 1 && reach_px >= step_px, "a soft edge's step must be within its reach"},
      {isPositive(initial_blur_px) && isPositive(min_blur_px),
       "the blur of soft edges must be positive"},
      {margin_px >= 0, "the margin of a soft marker must not be negative"},
  });
}

MarkerMeasurer::MarkerMeasurer(const CameraModel& camera, const Dictionary& dictionary,
                               MarkerDecoder* decoder, const EdgeRefinerOptions& edges,
                               const SoftEdgeOptions& soft)
    : camera_(camera),
      dictionary_(dictionary),
      decoder_(*decoder),
      soft_(soft),
      refiner_(camera, edges) {
  rings_.reserve(static_cast<std::size_t>(dictionary_.size()));
  for (int id = 0; id < dictionary_.size(); ++id) rings_.push_back(InnerRing::of(dictionary_, id));
}

Measurement MarkerMeasurer::measure(const ImageView& image, int id, const Corners& corners,
                                    const SideFits* edges) {
  return measureIn(image, image, id, corners, edges);
}

Measurement MarkerMeasurer::read(const ImageView& image, const Corners& corners) {
  const auto rough = refiner_.refine(image, corners, dictionary_.cells(), nullptr);
  if (!rough) return {};
  const QuadReading reading = decoder_.read(image, rough->normalized);
  if (reading.content != QuadContent::kMarker) return {.marker = {}, .has_edges = true};
  const int rotation = reading.match.rotation;
  const SideFits edges = turnedUpright(rough->edges, rotation);
  return measure(image, reading.match.id, turnedUpright(rough->normalized, rotation), &edges);
}

Measurement MarkerMeasurer::measureIn(const PlacedImage& placed, const ImageView& image, int id,
                                      const Corners& corners, const SideFits* edges) {
  const auto exact = refiner_.refine(placed, corners, dictionary_.cells(),
                                     &rings_[static_cast<std::size_t>(id)], edges);
  if (!exact) return {};
  const QuadReading reading = decoder_.read(image, straightened(*exact, camera_, placed.factor));
  if (reading.content != QuadContent::kMarker || reading.match.id != id ||
      reading.match.rotation != 0) {
    return {.marker = {}, .has_edges = true};
  }
  const double likeness = decoder_.likeness(id, meanOf(exact->edges, &EdgeFit::variance));
  if (likeness < decoder_.options().min_likeness) {
    return {.marker = {}, .has_edges = true, .is_unlike = true};
  }
  MeasuredMarker measured;
  measured.detection.id = id;
  measured.detection.likeness = likeness;
  measured.detection.hamming = reading.match.hamming;
  measured.detection.pixels = exact->pixels;
  measured.detection.normalized = exact->normalized;
  measured.detection.covariance = exact->covariance;
  measured.edges = exact->edges;
  measured.factor = placed.factor;
  return {.marker = measured, .has_edges = true};
}

// The smallest size first: that is where the softest edges are found from farthest.
std::optional<MeasuredMarker> MarkerMeasurer::readSoft(const ImageView& image,
                                                       const Corners& corners) {
  Corners pixels;
  for (std::size_t k = 0; k < 4; ++k) {
    pixels[k] = camera_.distort(corners[k]);
    if (!camera_.inImage(pixels[k])) return std::nullopt;
  }
  const double cell_px = sizeOf(pixels) / dictionary_.cells();
  if (cell_px < 2.0 * soft_.min_cell_px || !areSoft(image, pixels)) return std::nullopt;
  for (int factor = soft_.max_factor; factor > 1; factor /= 2) {
    if (cell_px < factor * soft_.min_cell_px) continue;
    if (auto measured = readReduced(image, corners, pixels, factor)) return measured;
  }
  return std::nullopt;
}

std::optional<MeasuredMarker> MarkerMeasurer::readReduced(const ImageView& image,
                                                          const Corners& corners,
                                                          const Corners& pixels, int factor) {
  SideFits start;
  for (EdgeFit& edge : start) edge.blur_px = soft_.initial_blur_px;
  const auto rough = refiner_.refine(reduced(image, pixels, factor), corners, dictionary_.cells(),
                                     nullptr, &start);
  if (!rough) return std::nullopt;
  const QuadReading reading = decoder_.read(image, rough->normalized);
  if (reading.content != QuadContent::kMarker) return std::nullopt;
  SideFits edges = turnedUpright(rough->edges, reading.match.rotation);
  while (factor > 1 && meanOf(edges, &EdgeFit::blur_px) < soft_.min_blur_px) {
    factor /= 2;
    edges = atTwiceTheSize(edges);
  }
  return measureIn(reduced(image, pixels, factor), image, reading.match.id,
                   turnedUpright(rough->normalized, reading.match.rotation), &edges)
      .marker;
}

// Of the grey levels across each side, the means along it. Most sides have to be soft.
bool MarkerMeasurer::areSoft(const ImageView& image, const Corners& pixels) {
  constexpr int kPlaces = 12;
  int soft = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d side = pixels[(k + 1) % 4] - pixels[k];
    const Eigen::Vector2d across = Eigen::Vector2d(side.y(), -side.x()).normalized();
    profile_.assign(static_cast<std::size_t>(2 * soft_.reach_px + 1), 0.0F);
    for (int i = 0; i < kPlaces; ++i) {
      const Eigen::Vector2d place = pixels[k] + (0.2 + 0.6 * i / (kPlaces - 1)) * side;
      for (int d = -soft_.reach_px; d <= soft_.reach_px; ++d) {
        const Eigen::Vector2d p = place + d * across;
        const int x = static_cast<int>(std::clamp(p.x() + 0.5, 0.0, image.width - 1.0));
        const int y = static_cast<int>(std::clamp(p.y() + 0.5, 0.0, image.height - 1.0));
        profile_[static_cast<std::size_t>(d + soft_.reach_px)] += image.at(x, y);
      }
    }
    const auto [least, most] = std::ranges::minmax(profile_);
    float step = 0.0F;
    for (std::size_t i = static_cast<std::size_t>(soft_.step_px); i < profile_.size(); ++i) {
      step = std::max(
          step, std::abs(profile_[i] - profile_[i - static_cast<std::size_t>(soft_.step_px)]));
    }
    if (step < static_cast<float>(soft_.max_step) * (most - least)) ++soft;
  }
  return soft >= 2;
}

// Precondition: factor is 1, 2 or 4.
PlacedImage MarkerMeasurer::reduced(const ImageView& image, const Corners& pixels, int factor) {
  if (factor == 1) return image;
  const Window window = windowAround(pixels, soft_.margin_px * factor, image);
  ImageView part = reducers_[0].reduce(partOf(image, window), 2);
  if (factor == 4) part = reducers_[1].reduce(part, 2);
  // The middle of a reduced pixel is in the middle of those it was made of.
  const Eigen::Vector2d origin =
      Eigen::Vector2d(window.left, window.top) + Eigen::Vector2d::Constant(0.5 * (factor - 1));
  return {part, origin, factor};
}

}  // namespace waymark::slam
