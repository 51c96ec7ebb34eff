// Detection: markers of the dictionary in an image, with exact corners. Where nothing is known of
// the image all of it is scanned; where something is, only what the caller (marker_follower.h) asks
// for.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/detection/codes/marker_decoder.h"
#include "slam/detection/edges/edge_refiner.h"
#include "slam/detection/marker_detection.h"
#include "slam/detection/marker_measurer.h"
#include "slam/detection/quads/quad_scanner.h"
#include "slam/detection/scan_budget.h"
#include "slam/detection/search/reduced_image.h"
#include "slam/detection/search/window.h"
#include "slam/detection/turn_picker.h"
#include "slam/geometry/camera_model.h"
#include "slam/stages.h"

namespace waymark::slam {

struct DetectorOptions {
  QuadScannerOptions scanner;
  EdgeRefinerOptions edges;
  SoftEdgeOptions soft;
  MarkerDecoderOptions decoder;
  ScanBudgetOptions budget;
  // A square that was no marker is not looked at again for so many frames: light and blur may be
  // better by then.
  int rejected_frames = 4;
  // It is the same one where centre and diagonal are within this share of its diagonal.
  double same_rejected = 0.2;
  // Nearer to the image's border than this it is looked at in every frame, pixels: what is only
  // just coming into view may be a marker in the next one.
  double entering_px = 12.0;
  // In images reduced to less than a half, squares with a shorter diagonal are left to larger
  // sizes, reduced pixels.
  double min_reduced_diagonal_px = 20.0;
  // A square found in a reduced image has corners good to a reduced pixel: where its cells are
  // smaller than so many of those, a code that is no marker's may be one with better corners.
  double readable_cell_px = 3.0;
  // What may be a marker in a reduced image is searched again in the whole one with this margin,
  // pixels: more than the adaptive threshold looks around.
  int reduced_margin_px = 12;
  // A quad is a marker that was found already where the centre is within this share of that
  // marker's size, and its own size within these factors of it.
  double known_centre = 0.1;
  double min_known_size = 0.8;
  double max_known_size = 1.25;
  // Large blurred markers have no outline at the full size: whole images are searched at a quarter
  // of it, too.
  int whole_reduced = 4;
  // Two of the same id are two outlines of one border where the centres are within this share of
  // the diagonal; else they are two prints.
  double same_place = 0.25;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// What became of the candidates, since the start.
struct DetectorCounters {
  std::uint64_t quads = 0;     // found in the image itself or in a part of it
  std::uint64_t no_edge = 0;   // a side had no clean edge
  std::uint64_t no_code = 0;   // no border, or a code that is not in the dictionary
  std::uint64_t unlike = 0;    // a code whose print it does not look like
  std::uint64_t merged = 0;    // another outline of a print that was found already
  std::uint64_t rejected = 0;  // rejected a few frames ago, and not looked at again
};

// What all scans have looked at.
struct ScanWork {
  std::uint64_t regions = 0;      // dark regions that quads were fitted to
  std::uint64_t compared = 0;     // pairs of quads
  std::uint64_t candidates = 0;   // quads that were looked at for a marker
  std::uint64_t futile_fits = 0;  // of these, looked at closely in vain
  std::uint64_t deferred = 0;     // regions and candidates that were left for later frames
};

enum class ScanOutcome {
  kDone,
  kTooBusy,  // there was much more than the budget allows
};

class MarkerDetector {
 public:
  // The camera must outlive the detector.
  MarkerDetector(const CameraModel& camera, Dictionary dictionary,
                 const DetectorOptions& options = {});

  // Full scan, however long it takes. Sorted by id, each print once: an id is there twice where two
  // prints have it. Valid until the next call.
  const std::vector<MarkerDetection>& detect(const ImageView& image);

  // The same piece by piece: begin(), any number of confirm() and scan(), finish().
  void begin();
  // Whether marker `id` is near where it is expected: `corners` (normalized), good to a pixel and a
  // half. `before`: it, as it looked before; may be null.
  bool confirm(const ImageView& image, int id, const std::array<Eigen::Vector2d, 4>& corners,
               const MeasuredMarker* before);
  // What all scans from one begin() to the next may look at; without one there is no bound.
  void setBudget(const ScanBudget& budget) { budget_ = left_ = budget; }
  // Learns that scans get on; may be null.
  void setObserver(StageObserver* observer) { observer_ = observer; }
  // Every marker that is whole in a window of the image. share: of what is left of the budget, as
  // much as the scan may spend. Parts of an image that is known to be busy are searched however
  // many runs they have.
  enum class Runs { kBounded, kUnbounded };
  ScanOutcome scan(const ImageView& image, const SearchRegion& region, double share = 1.0,
                   Runs runs = Runs::kBounded);
  // All of the image, and large blurred markers.
  ScanOutcome scanAll(const ImageView& image, std::uint32_t turn = 0);
  // As of detect().
  const std::vector<MarkerDetection>& finish();

  // Since begin(), in the order in which they were found; a print may be there twice.
  [[nodiscard]] const std::vector<MeasuredMarker>& measured() const { return measured_; }
  [[nodiscard]] const DetectorCounters& counters() const { return counters_; }
  [[nodiscard]] const ScanWork& work() const { return work_; }
  [[nodiscard]] const Dictionary& dictionary() const { return dictionary_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }

 private:
  // A square that was looked at and is no marker. A few frames later it is looked at again.
  struct Rejected {
    Eigen::Vector2d centre;  // pixels, where it was last
    double diagonal;
    int frames;  // since it was looked at
  };

  ScanOutcome scanWhole(const ImageView& image, const SearchRegion& region,
                        const ScanBudget& allowed);
  ScanOutcome scanReduced(const ImageView& image, const SearchRegion& region,
                          const ScanBudget& allowed);
  // first_come: whether some fits are made as candidates come.
  [[nodiscard]] ScanBudget allotment(double share, Runs runs, bool first_come) const;
  QuadScan scanForQuads(const ImageView& image, const SearchRegion& region,
                        const ScanBudget& allowed);
  [[nodiscard]] ScanOutcome outcomeOf(const QuadScan& scan, std::uint64_t deferred_before,
                                      const ScanBudget& allowed) const;
  // Leaves no more than `most` of candidates_.
  void deferCandidates(int most, std::uint32_t turn);
  void countCandidate();
  void countFutileFit();
  // Whether it was rejected a few frames ago; it is there now.
  [[nodiscard]] bool wasRejected(const Quad& quad);
  void reject(const Quad& quad);
  // Looks at candidates_, of which there are no more than allowed.
  void examineAll(const ImageView& image, const SearchRegion& region, const ScanBudget& allowed);
  // A border without a code that can be read with these corners.
  struct Unclear {
    Quad quad;
    std::array<Eigen::Vector2d, 4> corners;  // normalized
    float promise;
  };
  void examine(const ImageView& image, const Quad& quad, float promise, bool may_fit);
  void fitUnclear(const ImageView& image, int most, std::uint32_t turn);
  [[nodiscard]] std::optional<MeasuredMarker> readWithEdges(
      const ImageView& image, const std::array<Eigen::Vector2d, 4>& corners);
  // Counts why there is none.
  [[nodiscard]] std::optional<MeasuredMarker> counted(const Measurement& measurement);
  void keep(const Quad& quad, const std::optional<MeasuredMarker>& measured);
  [[nodiscard]] bool isKnown(const Quad& quad) const;
  void mergeOutlines();

  const CameraModel& camera_;
  DetectorOptions options_;
  Dictionary dictionary_;
  QuadScanner scanner_;
  MarkerDecoder decoder_;
  MarkerMeasurer measurer_;
  DetectorCounters counters_;
  std::vector<MeasuredMarker> measured_;
  std::vector<MarkerDetection> detections_;
  std::vector<Rejected> rejected_;
  ScanBudget budget_;
  ScanBudget left_;  // of it, since begin()
  ScanWork work_;
  StageObserver* observer_ = nullptr;
  TurnPicker picker_;
  // Reused from region to region.
  ImageReducer reducer_;
  std::vector<Quad> reduced_candidates_;
  std::vector<Quad> candidates_;
  std::vector<float> promise_;  // of candidates_
  std::vector<Unclear> unclear_;
};

}  // namespace waymark::slam
