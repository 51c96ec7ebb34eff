#include "slam/camera/lens_knowledge.h"

#include <numbers>

#include "slam/option_checks.h"

namespace waymark::slam {

IntrinsicVector LensPrior::sigmas(const CameraModel& expected) const {
  const Calibration& c = expected.calibration();
  const double centre_px = centre_share * c.width;
  // Where pixels are known to be squares, fx and fy speak of one length: each by itself says half.
  const double focal = aspect_share > 0.0 ? std::numbers::sqrt2 * focal_share : focal_share;
  IntrinsicVector sigmas;
  sigmas << focal * c.fx, focal * c.fy, centre_px, centre_px, radial, higher_radial, tangential,
      tangential, higher_radial;
  if (c.model == DistortionModel::kEquidistant) {
    // Of a polynomial in the angle, which is more than 1 in a wide image's corners, the highest
    // terms could fold the image there, where markers seldom are; lenses have little of them.
    sigmas.tail<5>() << radial, higher_radial, 0.5 * higher_radial, 0.2 * higher_radial, 0.0;
  }
  return sigmas;
}

std::string LensPrior::invalidReason() const {
  return firstUnmet({
      {isNotNegative(focal_share) && isNotNegative(aspect_share) && isNotNegative(centre_share) &&
           isNotNegative(radial) && isNotNegative(higher_radial) && isNotNegative(tangential),
       "the sigmas of a lens must not be negative"},
  });
}

const char* stateName(LensState state) {
  switch (state) {
    case LensState::kGiven:
      return "given";
    case LensState::kLearning:
      return "learning";
    case LensState::kLearned:
      return "learned";
  }
  return "";
}

const CameraModel& LensKnowledge::at(std::int64_t time_ns, const CameraModel& in_use) const {
  for (const EarlierLens& lens : earlier) {
    if (time_ns < lens.until_ns) return lens.camera;
  }
  return in_use;
}

void LensKnowledge::adopt(const CameraModel& found, const IntrinsicMatrix& its_covariance,
                          double before_px, double after_px, double learned_focal_share) {
  if (changes == 0) rms_given_px = before_px;
  covariance = its_covariance;
  focal_px = found.calibration().fx;
  rms_before_px = before_px;
  rms_after_px = after_px;
  ++changes;
  state = focalShare() <= learned_focal_share ? LensState::kLearned : LensState::kLearning;
}

bool coversImage(const CameraModel& camera) {
  const double right = camera.width() - 1.0;
  const double bottom = camera.height() - 1.0;
  for (const Eigen::Vector2d& corner :
       {Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(right, 0.0), Eigen::Vector2d(0.0, bottom),
        Eigen::Vector2d(right, bottom)}) {
    if (!camera.undistort(corner)) return false;
  }
  return true;
}

}  // namespace waymark::slam
