#include "slam/camera/lens_knowledge.h"

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Of any lens, by the shares.
IntrinsicMatrix ordinary(const LensPrior& prior, const Calibration& c) {
  const double centre_px = prior.centre_share * c.width;
  IntrinsicVector sigmas;
  sigmas << prior.focal_share * c.fx, prior.focal_share * c.fy, centre_px, centre_px, prior.radial,
      prior.higher_radial, prior.tangential, prior.tangential, prior.higher_radial;
  if (c.model == DistortionModel::kEquidistant) {
    // Of a polynomial in the angle, which is more than 1 in a wide image's corners, the highest
    // terms could fold the image there, where markers seldom are; lenses have little of them.
    sigmas.tail<5>() << prior.radial, prior.higher_radial, 0.5 * prior.higher_radial,
        0.2 * prior.higher_radial, 0.0;
  }
  IntrinsicMatrix covariance = sigmas.cwiseAbs2().asDiagonal();
  if (prior.aspect_share > 0.0 && prior.focal_share > 0.0) {
    // fx and fy speak of one length, and of their ratio.
    const Eigen::Vector2d together = prior.focal_share * Eigen::Vector2d(c.fx, c.fy);
    const Eigen::Vector2d apart = 0.5 * prior.aspect_share * Eigen::Vector2d(c.fx, -c.fy);
    covariance.topLeftCorner<2, 2>() = together * together.transpose() + apart * apart.transpose();
  }
  return covariance;
}

// As it was measured, and what has changed since.
IntrinsicMatrix measured(const LensPrior& prior, const Calibration& c) {
  IntrinsicVector focal = IntrinsicVector::Zero();
  focal.head<2>() = prior.since_focal_share * Eigen::Vector2d(c.fx, c.fy);
  IntrinsicMatrix covariance = *c.covariance + focal * focal.transpose();
  const double centre_px = prior.since_centre_share * c.width;
  covariance.diagonal().segment<2>(2).array() += centre_px * centre_px;
  return covariance;
}

}  // namespace

IntrinsicMatrix LensPrior::covariance(const CameraModel& expected) const {
  const Calibration& c = expected.calibration();
  return c.covariance ? measured(*this, c) : ordinary(*this, c);
}

bool LensPrior::isContradicted(const CameraModel& measured, const CameraModel& found) const {
  if (found.calibration().model != measured.calibration().model) return true;
  const IntrinsicVector apart = found.intrinsics() - measured.intrinsics();
  return !(apart.dot(informationOf(covariance(measured)) * apart) <= max_measured_chi2);
}

CameraModel LensPrior::expectedGiven(const CameraModel& expected, const CameraModel& found) const {
  const bool is_measured = expected.calibration().covariance.has_value();
  return is_measured && isContradicted(expected, found) ? asUnmeasured(expected) : expected;
}

std::string LensPrior::invalidReason() const {
  return firstUnmet({
      {isNotNegative(focal_share) && isNotNegative(aspect_share) && isNotNegative(centre_share) &&
           isNotNegative(radial) && isNotNegative(higher_radial) && isNotNegative(tangential) &&
           isNotNegative(since_focal_share) && isNotNegative(since_centre_share),
       "the sigmas of a lens must not be negative"},
      {isPositive(max_measured_chi2), "the chi-square of a measured lens must be positive"},
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

LensKnowledge LensKnowledge::of(const CameraModel& given, bool exact) {
  LensKnowledge knowledge{.given = exact ? asUnmeasured(given) : given};
  knowledge.covariance = knowledge.given.calibration().covariance.value_or(knowledge.covariance);
  knowledge.focal_px = given.calibration().fx;
  return knowledge;
}

const CameraModel& LensKnowledge::at(std::int64_t time_ns, const CameraModel& in_use) const {
  for (const EarlierLens& lens : earlier) {
    if (time_ns < lens.until_ns) return lens.camera;
  }
  return in_use;
}

Calibration LensKnowledge::calibrationOf(const CameraModel& in_use) const {
  Calibration c = in_use.calibration();
  if (!covariance.isZero(0.0)) c.covariance = covariance;
  return c;
}

bool LensKnowledge::refines(const CameraModel& found, const LensPrior& prior) const {
  return isMeasured() && !prior.isContradicted(given, found);
}

void LensKnowledge::adopt(const CameraModel& found, const IntrinsicMatrix& its_covariance,
                          double before_px, double after_px, const LensPrior& prior,
                          double learned_focal_share) {
  if (state == LensState::kGiven) rms_given_px = before_px;
  covariance = its_covariance;
  focal_px = found.calibration().fx;
  rms_before_px = before_px;
  rms_after_px = after_px;
  ++changes;
  refines_given = refines(found, prior);
  state = focalShare() <= learned_focal_share ? LensState::kLearned : LensState::kLearning;
}

void LensKnowledge::takeBack() {
  const int changes_so_far = changes;
  *this = of(given, /*exact=*/false);
  changes = changes_so_far + 1;
}

CameraModel asUnmeasured(const CameraModel& camera) {
  Calibration c = camera.calibration();
  c.covariance.reset();
  return CameraModel(c);
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
