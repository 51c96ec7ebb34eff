#include "slam/detection/marker_detector.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slam/geometry/plane.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Corners or sides as found, turned so that the first is the print's top-left or top.
template <typename T>
std::array<T, 4> upright(std::array<T, 4> found, int rotation) {
  std::rotate(found.begin(), found.begin() + rotation, found.end());
  return found;
}

Eigen::Vector2d centre(const MarkerDetection& d) { return centreOf(d.pixels); }
double diagonalOf(const Quad& quad) { return (quad[2] - quad[0]).norm(); }

double diagonal(const MarkerDetection& d) { return diagonalOf(d.pixels); }

constexpr std::size_t kMaxRejected = 256;  // what memory is taken for

// Nothing, and why.
std::nullopt_t count(std::uint64_t* reason) {
  ++*reason;
  return std::nullopt;
}

}  // namespace

std::string DetectorOptions::invalidReason() const {
  return firstReason({
      scanner.invalidReason(),
      edges.invalidReason(),
      decoder.invalidReason(),
      firstUnmet({
          {rejected_frames >= 0, "the frames of a rejected square must not be negative"},
          {isNotNegative(same_rejected),
           "the share of a same rejected square must not be negative"},
          {isNotNegative(entering_px), "the margin of what enters must not be negative"},
          {isNotNegative(min_reduced_diagonal_px),
           "the shortest reduced diagonal must not be negative"},
          {isNotNegative(readable_cell_px), "the size of a readable cell must not be negative"},
          {reduced_margin_px >= 0, "the margin of a reduced square must not be negative"},
          {isPositive(known_centre) && isPositive(min_known_size) &&
               max_known_size >= min_known_size,
           "a known square's share and factors must be positive"},
          {isNotNegative(same_place), "the share of a same place must not be negative"},
      }),
  });
}

MarkerDetector::MarkerDetector(const CameraModel& camera, Dictionary dictionary,
                               const DetectorOptions& options)
    : camera_(camera),
      options_(options),
      dictionary_(std::move(dictionary)),
      scanner_(options.scanner),
      refiner_(camera_, options.edges),
      decoder_(camera_, dictionary_, options.decoder) {
  rejected_.reserve(kMaxRejected);
  rings_.reserve(static_cast<std::size_t>(dictionary_.size()));
  for (int id = 0; id < dictionary_.size(); ++id) rings_.push_back(InnerRing::of(dictionary_, id));
}

const std::vector<MarkerDetection>& MarkerDetector::detect(const ImageView& image) {
  begin();
  scanWhole(image, {0, 0, image.width, image.height});
  return finish();
}

void MarkerDetector::begin() {
  measured_.clear();
  detections_.clear();
  std::erase_if(rejected_, [this](Rejected& rejected) {
    return ++rejected.frames > options_.rejected_frames;
  });
}

bool MarkerDetector::confirm(const ImageView& image, int id,
                             const std::array<Eigen::Vector2d, 4>& corners, const SideFits* edges) {
  // What never was there costs as little as a look.
  if (edges == nullptr && decoder_.read(image, corners).content == QuadContent::kNothing) {
    return false;
  }
  const auto measured = measure(image, id, corners, edges);
  if (measured) measured_.push_back(*measured);
  return measured.has_value();
}

void MarkerDetector::scan(const ImageView& image, const SearchRegion& turn) {
  if (turn.factor == 1) {
    scanWhole(image, turn.window, turn.max_px);
  } else {
    scanReduced(image, turn);
  }
}

const std::vector<MarkerDetection>& MarkerDetector::finish() {
  for (const MeasuredMarker& measured : measured_) detections_.push_back(measured.detection);
  mergeOutlines();
  return detections_;
}

void MarkerDetector::scanWhole(const ImageView& image, const Window& window, int max_px) {
  const bool in_turn = window.width < image.width || window.height < image.height;
  for (const Quad& found : scanner_.scan(partOf(image, window), max_px)) {
    ++counters_.quads;
    Quad quad = found;
    for (Eigen::Vector2d& corner : quad) corner += Eigen::Vector2d(window.left, window.top);
    if (isKnown(quad)) {
      ++counters_.merged;
    } else if (in_turn && wasRejected(quad)) {
      ++counters_.rejected;
    } else if (const auto measured = examine(image, quad)) {
      measured_.push_back(*measured);
    } else {
      reject(quad);
    }
  }
}

// What may be a marker there is looked at where it is in the image itself.
void MarkerDetector::scanReduced(const ImageView& image, const SearchRegion& turn) {
  const Window& window = turn.window;
  const int factor = turn.factor;
  candidates_.clear();
  for (Quad quad : scanner_.scan(reducer_.reduce(partOf(image, window), factor), turn.max_px)) {
    // The middle of a reduced pixel is in the middle of those it was made of.
    for (Eigen::Vector2d& corner : quad) {
      corner = factor * corner + Eigen::Vector2d(window.left, window.top) +
               Eigen::Vector2d::Constant(0.5 * (factor - 1));
    }
    // Smaller ones are found at a larger size.
    if (factor > 2 && diagonalOf(quad) < options_.min_reduced_diagonal_px * factor) continue;
    if (!isKnown(quad) && !wasRejected(quad)) candidates_.push_back(quad);
  }
  for (const Quad& quad : candidates_) {
    const auto corners = undistortCorners(camera_, quad);
    if (!corners) continue;
    const QuadContent content = decoder_.read(image, *corners).content;
    const bool unreadable =
        diagonalOf(quad) < options_.readable_cell_px * factor * dictionary_.cells();
    if (content == QuadContent::kNothing || (content == QuadContent::kNoCode && !unreadable)) {
      reject(quad);
      continue;
    }
    const std::size_t before = measured_.size();
    scanWhole(image, windowAround(quad, options_.reduced_margin_px + factor, image));
    if (measured_.size() == before) reject(quad);
  }
}

bool MarkerDetector::wasRejected(const Quad& quad) {
  const Eigen::Vector2d centre = centreOf(quad);
  const double diagonal = diagonalOf(quad);
  const auto known = std::ranges::find_if(rejected_, [&](const Rejected& rejected) {
    return (rejected.centre - centre).norm() < options_.same_rejected * diagonal &&
           std::abs(rejected.diagonal - diagonal) < options_.same_rejected * diagonal;
  });
  if (known == rejected_.end()) return false;
  known->centre = centre;
  return true;
}

// What is only just coming into view may be a marker in the next frame.
void MarkerDetector::reject(const Quad& quad) {
  const bool inside = std::ranges::all_of(quad, [&](const Eigen::Vector2d& corner) {
    return camera_.inImage(corner, options_.entering_px);
  });
  if (inside && rejected_.size() < kMaxRejected)
    rejected_.push_back({centreOf(quad), diagonalOf(quad), 0});
}

// Most codes can be read with the corners as they were found, and most of what is no marker looks
// like none: exact corners are for markers. Small ones are read with better corners.
std::optional<MeasuredMarker> MarkerDetector::examine(const ImageView& image, const Quad& quad) {
  auto corners = undistortCorners(camera_, quad);
  if (!corners) return count(&counters_.no_edge);
  std::optional<SideFits> edges;
  QuadReading reading = decoder_.read(image, *corners);
  if (reading.content == QuadContent::kNoCode) {
    const auto rough = refiner_.refine(image, *corners, dictionary_.cells(), nullptr);
    if (!rough) return count(&counters_.no_edge);
    corners = rough->normalized;
    edges = rough->edges;
    reading = decoder_.read(image, *corners);
  }
  if (reading.content != QuadContent::kMarker) return count(&counters_.no_code);
  const Dictionary::Match& match = reading.match;
  if (edges) edges = upright(*edges, match.rotation);
  return measure(image, match.id, upright(*corners, match.rotation), edges ? &*edges : nullptr);
}

std::optional<MeasuredMarker> MarkerDetector::measure(const ImageView& image, int id,
                                                      const std::array<Eigen::Vector2d, 4>& corners,
                                                      const SideFits* edges) {
  const auto exact = refiner_.refine(image, corners, dictionary_.cells(),
                                     &rings_[static_cast<std::size_t>(id)], edges);
  if (!exact) return count(&counters_.no_edge);
  const QuadReading reading = decoder_.read(image, exact->normalized);
  if (reading.content != QuadContent::kMarker || reading.match.id != id ||
      reading.match.rotation != 0) {
    return count(&counters_.no_code);
  }
  MeasuredMarker measured;
  measured.detection.id = id;
  measured.detection.hamming = reading.match.hamming;
  measured.detection.pixels = exact->pixels;
  measured.detection.normalized = exact->normalized;
  measured.detection.covariance = exact->covariance;
  measured.edges = exact->edges;
  return measured;
}

// The same marker found with another threshold.
bool MarkerDetector::isKnown(const Quad& quad) const {
  const Eigen::Vector2d middle = centreOf(quad);
  const double size = (quad[2] - quad[0]).norm() + (quad[3] - quad[1]).norm();
  return std::ranges::any_of(measured_, [&](const MeasuredMarker& measured) {
    const MarkerDetection& known = measured.detection;
    const double known_size = diagonal(known) + (known.pixels[3] - known.pixels[1]).norm();
    return (centre(known) - middle).norm() < options_.known_centre * known_size &&
           size > options_.min_known_size * known_size &&
           size < options_.max_known_size * known_size;
  });
}

// Of the outlines of one border, the outermost stays. Two prints of one id both stay: who uses them
// decides what that means.
void MarkerDetector::mergeOutlines() {
  std::sort(detections_.begin(), detections_.end(),
            [](const MarkerDetection& a, const MarkerDetection& b) {
              if (a.id != b.id) return a.id < b.id;
              return diagonal(a) > diagonal(b);
            });
  auto kept = detections_.begin();  // where those that stay end
  for (auto next = detections_.begin(); next != detections_.end(); ++next) {
    const bool merged = std::any_of(detections_.begin(), kept, [&](const MarkerDetection& other) {
      return other.id == next->id &&
             (centre(*next) - centre(other)).norm() < options_.same_place * diagonal(other);
    });
    if (merged) {
      ++counters_.merged;
    } else {
      *kept++ = *next;
    }
  }
  detections_.erase(kept, detections_.end());
}

}  // namespace waymark::slam
