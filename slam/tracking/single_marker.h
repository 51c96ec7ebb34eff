// Frames that show one known marker only: its corners leave two poses (seed 1, section 3.2), and
// one image alone does not tell which. Both are followed from frame to frame, and what each image
// says for one and against the other is added up: a sequential likelihood ratio test, whose chance
// of ever deciding for the wrong one is exp(-min_log_odds), however long it goes on.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "slam/camera_pose/known_marker.h"
#include "slam/marker_pose/square_pose.h"
#include "slam/tracking/single_marker_view.h"

namespace waymark::slam {

struct SingleMarkerOptions {
  // Odds, as their natural logarithm, from which one of the poses is taken for the right one. More
  // takes longer to decide, less is wrong more often: 8 is one track in 3000.
  double min_log_odds = 8.0;
  // No more is remembered, so that a pose once trusted can be given up again.
  double max_log_odds = 24.0;
  // Two poses are two only if the one half-way between them explains the image worse than either by
  // this much, in squared whitened residuals: else the corners allow all from the one to the other
  // (a marker seen nearly from the front), and nothing says any more which was which.
  double min_barrier = 9.0;
  // Where nothing is decided, and no frame before tells where the camera is, there is a pose only
  // if it is known so well with the other one in its covariance, radians. More has poses of markers
  // seen from the front sooner, less certain ones.
  double max_undecided_sigma_rad = 0.06;
  // After a longer gap nothing says which of two poses was which, seconds.
  double max_gap_s = 0.5;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class SingleMarkerJudge {
 public:
  SingleMarkerJudge(double focal_px, const SingleMarkerOptions& options,
                    const SquarePoseOptions& square)
      : focal_px_(focal_px), options_(options), square_(square) {}

  // A frame of that time in which only this marker counts: of its two poses the one that more
  // speaks for. expected_T_w_c: where the camera must be, as several markers said a moment ago; it
  // decides at the start. Empty where the corners give no pose.
  [[nodiscard]] std::optional<PoseOfTwo> judge(const KnownMarker& marker, std::int64_t time_ns,
                                               const std::optional<Transform>& expected_T_w_c);
  // Others were in view, or none.
  void forget() { track_.reset(); }

 private:
  struct Track {
    int marker = -1;
    std::int64_t time_ns = 0;
    std::array<Transform, 2> T_m_c;  // the two poses
    double log_odds = 0.0;           // of the first over the second
  };
  double focal_px_;
  SingleMarkerOptions options_;
  SquarePoseOptions square_;
  std::optional<Track> track_;
};

}  // namespace waymark::slam
