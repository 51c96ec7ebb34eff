// Of VisualFilter: what a rolling shutter does to where features are seen.
#include "slam/geometry/image_velocity.h"
#include "slam/natural/filter/point_view.h"
#include "slam/natural/filter/visual_filter.h"

namespace waymark::slam {

auto VisualFilter::skewOf(const CameraModel& camera, double row_px, const Eigen::Vector3d& y,
                          double rho) const -> Skew {
  Skew skew;
  if (readout_s_ == 0.0) return skew;
  const FilterState& state = filter_.state();
  const Eigen::Matrix3d R_c_w = state.camera().R.transpose();
  Matrix26d by_twist = imageVelocityJacobian(y);
  by_twist.leftCols<3>() *= rho;
  Twist twist;
  twist << R_c_w * state.velocity(), state.angularVelocity();
  by_twist *= readout_s_ * rowTime(row_px, camera.height());
  skew.shift = by_twist * twist;
  // As if each feature had a motion of its own: its error is one for all of them, and goes into
  // what is estimated of the camera only as noise.
  by_twist.leftCols<3>() *= R_c_w;
  constexpr int kVelocity = 6;  // of the filter's coordinates
  skew.covariance = by_twist * state.P<6, 6>(kVelocity, kVelocity) * by_twist.transpose();
  return skew;
}

void VisualFilter::expectSkewed(const CameraModel& camera, Candidate* candidate) const {
  if (readout_s_ == 0.0) return;
  const StateFeature& f = stateOf(candidate->feature);
  const Transform& T_w_a = filter_.state().poses()[static_cast<std::size_t>(f.pose)].T_w_s;
  const Eigen::Vector3d y = directionTo(f, T_w_a, filter_.state().camera());
  if (!(y.z() > 0.0)) return;
  const Skew skew = skewOf(camera, candidate->expected.pixel.y(), y, f.rho);
  Eigen::Matrix2d D;
  (void)camera.distort(y.head<2>() / y.z(), &D);
  candidate->skew = {D * skew.shift, D * skew.covariance * D.transpose()};
  candidate->expected.pixel += candidate->skew.shift;
  candidate->expected.covariance += candidate->skew.covariance;
}

}  // namespace waymark::slam
