#include "slam/detection/marker_detector.h"

#include <algorithm>
#include <utility>

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

Eigen::Vector2d centre(const MarkerDetection& d) {
  return 0.25 * (d.pixels[0] + d.pixels[1] + d.pixels[2] + d.pixels[3]);
}

double diagonal(const MarkerDetection& d) { return (d.pixels[2] - d.pixels[0]).norm(); }

}  // namespace

MarkerDetector::MarkerDetector(const CameraModel& camera, Dictionary dictionary,
                               const DetectorOptions& options)
    : camera_(camera),
      dictionary_(std::move(dictionary)),
      table_(camera),
      scanner_(options.scanner),
      refiner_(camera_, table_, options.edges),
      decoder_(camera_, dictionary_, options.decoder) {
  rings_.reserve(static_cast<std::size_t>(dictionary_.size()));
  for (int id = 0; id < dictionary_.size(); ++id) rings_.push_back(InnerRing::of(dictionary_, id));
}

const std::vector<MarkerDetection>& MarkerDetector::detect(const ImageView& image) {
  detections_.clear();
  counters_ = {};
  for (const Quad& quad : scanner_.scan(image)) {
    ++counters_.quads;
    const auto rough = refiner_.refine(image, quad, dictionary_.cells(), nullptr);
    if (!rough) {
      ++counters_.no_edge;
      continue;
    }
    const auto match = decoder_.decode(image, rough->normalised, rough->black, rough->white);
    if (!match) {
      ++counters_.no_code;
      continue;
    }
    const auto fine =
        refiner_.refine(image, upright(rough->pixels, match->rotation), dictionary_.cells(),
                        &rings_[static_cast<std::size_t>(match->id)]);
    if (!fine) {
      ++counters_.no_edge;
      continue;
    }
    MarkerDetection detection;
    detection.id = match->id;
    detection.hamming = match->hamming;
    detection.pixels = fine->pixels;
    detection.normalised = fine->normalised;
    detection.covariance = fine->covariance;
    detections_.push_back(detection);
  }
  removeRepeated();
  return detections_;
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
