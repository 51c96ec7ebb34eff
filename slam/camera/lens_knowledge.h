// What is known of the lens: how well it is expected to be known beforehand, and what the map has
// taught of it since. One for all pieces of the map: they are seen through the same lens.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "slam/geometry/camera_model.h"

namespace waymark::slam {

// How well a calibration is known before the map has anything to say of it: standard deviations.
struct LensPrior {
  // Of the focal length, as a share of it. An autofocus, or another copy of the same camera, is
  // some percent off; larger lets a lens that is nearly known wander where the markers say little.
  double focal_share = 0.05;
  // Of the ratio of fx and fy. Pixels are squares, but images that were scaled to a round size, and
  // lenses, leave some thousandths of it; tighter turns these into a wrong focal length that looks
  // certain, larger lets a few frontal views squeeze the image.
  double aspect_share = 2e-3;
  // Of the centre, as a share of the image's width. Lenses sit some 1 to 2 % off.
  double centre_share = 0.015;
  // Of the first radial coefficient, and of each further one. Nothing limits the first one much;
  // the others differ less from lens to lens, and where no marker has been they are all that keeps
  // the lens from being bent at will.
  double radial = 0.15;
  double higher_radial = 0.06;
  // Of the tangential ones: lenses are mounted straight.
  double tangential = 0.001;
  // Of a calibration that says itself how well it was measured, what may have changed since then,
  // by warmth and handling: of the focal length as a share of it, of the centre as a share of the
  // image's width. Larger makes less of the measurement.
  double since_focal_share = 5e-4;
  double since_centre_share = 5e-4;
  // One that is further from what is found than this is held no more than any other, as chi-square
  // of the nine intrinsics: once in 1,000 by chance.
  double max_measured_chi2 = 28.0;

  // Of the lens that is expected, in the order of IntrinsicVector; zero for what is known exactly.
  [[nodiscard]] IntrinsicMatrix covariance(const CameraModel& expected) const;
  // A lens that somebody has measured cannot be the one that was found.
  [[nodiscard]] bool isContradicted(const CameraModel& measured, const CameraModel& found) const;
  // The lens that is expected, given what was found: not as somebody has measured it, if that is
  // another one.
  [[nodiscard]] CameraModel expectedGiven(const CameraModel& expected,
                                          const CameraModel& found) const;
  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

enum class LensState : std::uint8_t {
  kGiven,     // as it was given: nothing contradicts it, or nobody asks
  kLearning,  // another one than was given, that is not known well yet
  kLearned,
};

// "given", "learning", "learned".
[[nodiscard]] const char* stateName(LensState state);

// One that was in use before the lens changed under way.
struct EarlierLens {
  CameraModel camera;
  std::int64_t until_ns = 0;  // of the frames, monotonic
  bool dated = false;         // as the map has it; else by when the change was noticed
};

// The lens in use itself is the CameraModel that all share.
struct LensKnowledge {
  LensState state = LensState::kGiven;
  CameraModel given;  // or guessed
  // Of the intrinsics in use. As long as they are believed as given, what their calibration says,
  // and zero if it says nothing.
  IntrinsicMatrix covariance = IntrinsicMatrix::Zero();
  // RMS of the whitened residuals' corners before and after the last change, pixels.
  double focal_px = 1.0;      // that it is the covariance of
  double rms_given_px = 0.0;  // with the lens as it was given; 0 as long as that is in use
  double rms_before_px = 0.0;
  double rms_after_px = 0.0;
  int changes = 0;  // of the lens in use so far
  // The lens in use is the one that was given, measured better; else it is another one.
  bool refines_given = false;
  // The lens in use is of the frames since then, nanoseconds (monotonic); others before it, oldest
  // first.
  std::int64_t since_ns = std::numeric_limits<std::int64_t>::min();
  std::vector<EarlierLens> earlier{};

  // Before the map has said anything. exact: whatever the calibration says of itself.
  [[nodiscard]] static LensKnowledge of(const CameraModel& given, bool exact);

  [[nodiscard]] bool changedUnderWay() const { return !earlier.empty(); }
  // Of a frame, given the one in use.
  [[nodiscard]] const CameraModel& at(std::int64_t time_ns, const CameraModel& in_use) const;
  // With what is known of it, for a file.
  [[nodiscard]] Calibration calibrationOf(const CameraModel& in_use) const;
  // Somebody has measured it and says how well.
  [[nodiscard]] bool isMeasured() const { return given.calibration().covariance.has_value(); }
  // What was found is the lens that was measured, and the map measures it better; else it is
  // another one.
  [[nodiscard]] bool refines(const CameraModel& found, const LensPrior& prior) const;
  // The caller puts it in use.
  void adopt(const CameraModel& found, const IntrinsicMatrix& its_covariance, double before_px,
             double after_px, const LensPrior& prior, double learned_focal_share);
  // The one that was given fits as well after all; the caller puts it in use. Precondition: the
  // lens has not changed under way.
  void takeBack();
  // Standard deviation of the focal length in use, as a share of it.
  [[nodiscard]] double focalShare() const { return std::sqrt(covariance(0, 0)) / focal_px; }
};

// The same lens, that nobody has measured.
[[nodiscard]] CameraModel asUnmeasured(const CameraModel& camera);

// Whether a lens sees all of the image: it has an inverse up to the corners.
[[nodiscard]] bool coversImage(const CameraModel& camera);

}  // namespace waymark::slam
