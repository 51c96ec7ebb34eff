// Detection: every marker of the dictionary in an image, with exact corners.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "base/image_view.h"
#include "slam/detection/dictionary.h"
#include "slam/detection/edge_refiner.h"
#include "slam/detection/marker_decoder.h"
#include "slam/detection/marker_detection.h"
#include "slam/detection/quad_scanner.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

struct DetectorOptions {
  QuadScannerOptions scanner;
  EdgeRefinerOptions edges;
  MarkerDecoderOptions decoder;
};

// What became of the candidates of the last image.
struct DetectorCounters {
  int quads = 0;
  int no_edge = 0;   // a side had no clean edge
  int no_code = 0;   // no border, or a code that is not in the dictionary
  int doubled = 0;   // found again at the same place
  int repeated = 0;  // same id at another place: two prints, both left out
};

class MarkerDetector {
 public:
  // The camera must outlive the detector.
  MarkerDetector(const CameraModel& camera, Dictionary dictionary,
                 const DetectorOptions& options = {});

  // Full scan. Sorted by id; each id at most once. Valid until the next call.
  const std::vector<MarkerDetection>& detect(const ImageView& image);

  [[nodiscard]] const DetectorCounters& counters() const { return counters_; }
  [[nodiscard]] const Dictionary& dictionary() const { return dictionary_; }

 private:
  [[nodiscard]] std::optional<MarkerDetection> examine(const ImageView& image, const Quad& quad);
  [[nodiscard]] bool isKnown(const Quad& quad) const;
  void removeRepeated();

  const CameraModel& camera_;
  Dictionary dictionary_;
  std::vector<InnerRing> rings_;  // by id
  QuadScanner scanner_;
  EdgeRefiner refiner_;
  MarkerDecoder decoder_;
  DetectorCounters counters_;
  std::vector<MarkerDetection> detections_;
};

}  // namespace waymark::slam
