#include "slam/natural/filter/point_view.h"

namespace waymark::slam {
namespace {

// What is behind the camera or nearly beside it, as a share of its distance.
constexpr double kLeastForward = 0.05;

// d normalized / d y of a direction y.
Matrix23d directionJacobian(const Eigen::Vector3d& y) {
  const double iz = 1.0 / y.z();
  Matrix23d J;
  J << iz, 0.0, -y.x() * iz * iz, 0.0, iz, -y.y() * iz * iz;
  return J;
}

}  // namespace

bool viewFeature(const CameraModel& camera, const Transform& T_w_c, const Transform& T_w_a,
                 const StateFeature& feature, PointView* view) {
  // The direction to the point, times rho: finite also when it is infinitely far away.
  const Eigen::Vector3d ray_w = T_w_a.R * Eigen::Vector3d(feature.uv.x(), feature.uv.y(), 1.0);
  const Eigen::Vector3d between_w = T_w_a.p - T_w_c.p;
  const Eigen::Vector3d y = T_w_c.R.transpose() * (ray_w + feature.rho * between_w);
  if (!(y.z() > kLeastForward * y.norm())) return false;
  const Eigen::Vector2d normalized = y.head<2>() / y.z();
  if (normalized.squaredNorm() > camera.maxRadius() * camera.maxRadius()) return false;
  Eigen::Matrix2d D;
  view->at = camera.distort(normalized, &D);
  const Matrix23d J = D * directionJacobian(y) * T_w_c.R.transpose();
  view->J_pose.leftCols<3>() = feature.rho * J;
  view->J_pose.rightCols<3>() = -J * skew(ray_w + feature.rho * T_w_a.p);
  view->J_feature.leftCols<2>() = J * T_w_a.R.leftCols<2>();
  view->J_feature.col(2) = J * between_w;
  const Eigen::RowVector3d axis = T_w_c.R.col(2).transpose() / y.z();
  view->J_forward << axis * T_w_a.R.leftCols<2>(), axis * between_w;
  return true;
}

std::optional<DepthView> viewDepth(const Transform& T_w_c, const Transform& T_w_a,
                                   const StateFeature& feature) {
  const Eigen::Vector3d ray_w = T_w_a.R * Eigen::Vector3d(feature.uv.x(), feature.uv.y(), 1.0);
  const Eigen::Vector3d between_w = T_w_a.p - T_w_c.p;
  const Eigen::Vector3d y_w = ray_w + feature.rho * between_w;
  const Eigen::RowVector3d axis = T_w_c.R.col(2).transpose();
  const double forward = axis * y_w;
  if (!(forward > kLeastForward * y_w.norm())) return std::nullopt;
  DepthView view;
  view.rho = feature.rho / forward;
  // rho / forward: what moves the point's direction away from the axis makes it deeper.
  const Eigen::RowVector3d J = -view.rho / forward * axis;
  view.J_pose.leftCols<3>() = feature.rho * J;
  view.J_pose.rightCols<3>() = -J * skew(ray_w + feature.rho * T_w_a.p);
  view.J_feature.leftCols<2>() = J * T_w_a.R.leftCols<2>();
  view.J_feature[2] = J * between_w + 1.0 / forward;
  return view;
}

bool viewPoint(const Transform& T_w_c, const Transform& T_w_s, const Eigen::Vector3d& p_s,
               PointView* view) {
  const Eigen::Vector3d p_w = T_w_s * p_s;
  const Eigen::Vector3d y = T_w_c.R.transpose() * (p_w - T_w_c.p);
  if (y.z() < kNearestDepth) return false;
  view->at = y.head<2>() / y.z();
  const Matrix23d J = directionJacobian(y) * T_w_c.R.transpose();
  view->J_pose.leftCols<3>() = J;
  view->J_pose.rightCols<3>() = -J * skew(p_w);
  view->J_feature.setZero();
  return true;
}

}  // namespace waymark::slam
