#include "slam/detection/marker_detector.h"

#include <algorithm>
#include <utility>

#include "slam/geometry/plane.h"

namespace waymark::slam {
namespace {

// quad corners as found, turned so that the first is the print's top-left.
std::array<Eigen::Vector2d, 4> upright(const std::array<Eigen::Vector2d, 4>& corners,
                                       int rotation) {
  std::array<Eigen::Vector2d, 4> turned;
  for (std::size_t k = 0; k < 4; ++k) {
    turned[k] = corners[(k + static_cast<std::size_t>(rotation)) % 4];
  }
  return turned;
}

Eigen::Vector2d centre(const MarkerDetection& d) { return centreOf(d.pixels); }
double diagonal(const MarkerDetection& d) { return (d.pixels[2] - d.pixels[0]).norm(); }

// Nothing, and why.
std::nullopt_t count(int* reason) {
  ++*reason;
  return std::nullopt;
}

}  // namespace

MarkerDetector::MarkerDetector(const CameraModel& camera, Dictionary dictionary,
                               const DetectorOptions& options)
    : camera_(camera),
      dictionary_(std::move(dictionary)),
      scanner_(options.scanner),
      refiner_(camera_, options.edges),
      decoder_(camera_, dictionary_, options.decoder) {
  rings_.reserve(static_cast<std::size_t>(dictionary_.size()));
  for (int id = 0; id < dictionary_.size(); ++id) rings_.push_back(InnerRing::of(dictionary_, id));
}

const std::vector<MarkerDetection>& MarkerDetector::detect(const ImageView& image) {
  detections_.clear();
  counters_ = {};
  for (const Quad& quad : scanner_.scan(image)) {
    ++counters_.quads;
    if (isKnown(quad)) {
      ++counters_.doubled;
      continue;
    }
    if (const auto detection = examine(image, quad)) detections_.push_back(*detection);
  }
  removeRepeated();
  return detections_;
}

// Most codes can be read with the corners as they were found, and most of what is no marker looks
// like none: exact corners are for markers. Small ones are read with better corners.
std::optional<MarkerDetection> MarkerDetector::examine(const ImageView& image, const Quad& quad) {
  auto corners = undistortCorners(camera_, quad);
  if (!corners) return count(&counters_.no_edge);
  std::optional<double> blur_px;
  QuadReading reading = decoder_.read(image, *corners);
  if (reading.content == QuadContent::kNoCode) {
    const auto rough = refiner_.refine(image, *corners, dictionary_.cells(), nullptr);
    if (!rough) return count(&counters_.no_edge);
    corners = rough->normalised;
    blur_px = rough->blur_px;
    reading = decoder_.read(image, *corners);
  }
  if (reading.content != QuadContent::kMarker) return count(&counters_.no_code);
  const Dictionary::Match& match = reading.match;
  const auto fine = refiner_.refine(image, upright(*corners, match.rotation), dictionary_.cells(),
                                    &rings_[static_cast<std::size_t>(match.id)], blur_px);
  if (!fine) return count(&counters_.no_edge);
  // What was read with rough corners has to stand with the exact ones.
  const QuadReading again = decoder_.read(image, fine->normalised);
  if (again.content != QuadContent::kMarker || again.match.id != match.id ||
      again.match.rotation != 0) {
    return count(&counters_.no_code);
  }
  MarkerDetection detection;
  detection.id = match.id;
  detection.hamming = again.match.hamming;
  detection.pixels = fine->pixels;
  detection.normalised = fine->normalised;
  detection.covariance = fine->covariance;
  return detection;
}

// The same marker found with another threshold.
bool MarkerDetector::isKnown(const Quad& quad) const {
  const Eigen::Vector2d middle = centreOf(quad);
  const double size = (quad[2] - quad[0]).norm() + (quad[3] - quad[1]).norm();
  return std::ranges::any_of(detections_, [&](const MarkerDetection& known) {
    const double known_size = diagonal(known) + (known.pixels[3] - known.pixels[1]).norm();
    return (centre(known) - middle).norm() < 0.1 * known_size && size > 0.8 * known_size &&
           size < 1.25 * known_size;
  });
}

void MarkerDetector::removeRepeated() {
  std::sort(detections_.begin(), detections_.end(),
            [](const MarkerDetection& a, const MarkerDetection& b) {
              if (a.id != b.id) return a.id < b.id;
              return diagonal(a) > diagonal(b);
            });
  std::vector<MarkerDetection>::iterator out = detections_.begin();
  for (auto first = detections_.begin(); first != detections_.end();) {
    const auto last = std::find_if(first, detections_.end(),
                                   [&](const MarkerDetection& d) { return d.id != first->id; });
    bool elsewhere = false;
    for (auto other = first + 1; other < last; ++other) {
      const bool same_place = (centre(*other) - centre(*first)).norm() < 0.25 * diagonal(*first);
      elsewhere = elsewhere || !same_place;
      ++(same_place ? counters_.doubled : counters_.repeated);
    }
    if (!elsewhere) *out++ = *first;  // of two outlines of one border, the outer one
    first = last;
  }
  detections_.erase(out, detections_.end());
}

}  // namespace waymark::slam
