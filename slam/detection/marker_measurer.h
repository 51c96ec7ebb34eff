// A marker's code and exact corners, from corners as a search found them. Where its edges are too
// soft to be fitted in the image itself, from defocus or motion, they are fitted in a reduced one.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/detection/codes/marker_decoder.h"
#include "slam/detection/edges/edge_refiner.h"
#include "slam/detection/edges/placed_image.h"
#include "slam/detection/marker_detection.h"
#include "slam/detection/search/reduced_image.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

struct SoftEdgeOptions {
  // Edges are fitted at 1/max_factor of the size at least: 1, 2 or 4. 1: never reduced.
  int max_factor = 4;
  // A cell has to have so many pixels there.
  double min_cell_px = 2.5;
  // A side is soft where grey levels change within `step_px` across it by less than this share of
  // what they do within `reach_px` of it: a blur of two pixels or more.
  double max_step = 0.6;
  int step_px = 3;
  int reach_px = 8;
  // Standard deviation of the blur to start from, reduced pixels.
  double initial_blur_px = 1.5;
  // What is blurred by less is fitted at twice the size, reduced pixels: there is nothing in finer
  // pixels that is not in these.
  double min_blur_px = 1.0;
  // So much of the image around a marker is reduced with it, reduced pixels.
  int margin_px = 12;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A marker in an image, and how its edges look there.
struct MeasuredMarker {
  MarkerDetection detection;
  SideFits edges;
  int factor = 1;  // at 1/factor of the image's size
};

// What came of a look at a marker.
struct Measurement {
  std::optional<MeasuredMarker> marker;
  bool has_edges = false;  // if there is none: its sides have clean edges, but it has no code, ...
  bool is_unlike = false;  // ... or one whose print it does not look like
};

class MarkerMeasurer {
 public:
  using Corners = std::array<Eigen::Vector2d, 4>;

  // The references must outlive it.
  MarkerMeasurer(const CameraModel& camera, const Dictionary& dictionary, MarkerDecoder* decoder,
                 const EdgeRefinerOptions& edges, const SoftEdgeOptions& soft);

  // Of a marker whose id is known. `corners`: normalized, upright. What was read with rough corners
  // has to stand with exact ones. `edges`: as they looked before in the image at its full size; may
  // be null.
  [[nodiscard]] Measurement measure(const ImageView& image, int id, const Corners& corners,
                                    const SideFits* edges);
  // With better corners than a search has. `corners`: normalized, starting anywhere.
  [[nodiscard]] Measurement read(const ImageView& image, const Corners& corners);
  // The same where edges are soft; nothing where they are not.
  [[nodiscard]] std::optional<MeasuredMarker> readSoft(const ImageView& image,
                                                       const Corners& corners);

 private:
  [[nodiscard]] Measurement measureIn(const PlacedImage& placed, const ImageView& image, int id,
                                      const Corners& corners, const SideFits* edges);
  [[nodiscard]] bool areSoft(const ImageView& image, const Corners& pixels);
  [[nodiscard]] std::optional<MeasuredMarker> readReduced(const ImageView& image,
                                                          const Corners& corners,
                                                          const Corners& pixels, int factor);
  [[nodiscard]] PlacedImage reduced(const ImageView& image, const Corners& pixels, int factor);

  const CameraModel& camera_;
  const Dictionary& dictionary_;
  MarkerDecoder& decoder_;
  SoftEdgeOptions soft_;
  std::vector<InnerRing> rings_;  // by id
  EdgeRefiner refiner_;
  std::array<ImageReducer, 2> reducers_;  // to a half, and to a half of that
  std::vector<float> profile_;            // grey levels across a side, reused
};

}  // namespace waymark::slam
