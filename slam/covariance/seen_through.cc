#include "slam/covariance/seen_through.h"

#include <array>
#include <cstddef>
#include <span>

#include <Eigen/Cholesky>

#include "slam/covariance/pose_by_camera.h"
#include "slam/geometry/image_velocity.h"
#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"

namespace waymark::slam {
namespace {

// A point of the plane, and where a global shutter would show it through the lens in use.
struct PlanePoint {
  Eigen::Vector3d p_m;
  Eigen::Vector2d pixel;  // where it was seen
  Eigen::Vector2d normalized;
  Eigen::Matrix2d J_lens;  // d pixel / d normalized: the image is fitted in pixels
};

constexpr std::size_t kAcross = 7;  // of the grid over the plane

struct PlanePoints {
  std::array<PlanePoint, kAcross * kAcross> of_grid;
  std::size_t count = 0;

  [[nodiscard]] std::span<const PlanePoint> inView() const { return {of_grid.data(), count}; }
};

bool nothingLearned(const SeenThrough& frame) {
  const bool same_lens = frame.found_with.calibration() == frame.by_now.camera->calibration();
  const bool same_rows = frame.readout_s == 0.0 || frame.twist.isZero(0.0);
  return same_lens && same_rows && frame.by_now.unknown().count == 0;
}

// Empty where a lens has no inverse there.
std::optional<PlanePoints> pointsInView(const SeenThrough& frame, const Transform& T_c_m,
                                        double width_m, double height_m) {
  PlanePoints points;
  const auto place = [](std::size_t i) { return static_cast<double>(i) / (kAcross - 1) - 0.5; };
  for (std::size_t i = 0; i < points.of_grid.size(); ++i) {
    const Eigen::Vector3d p_m(place(i % kAcross) * width_m, place(i / kAcross) * height_m, 0.0);
    const Eigen::Vector3d p_c = T_c_m * p_m;
    const auto pixel = frame.found_with.project(p_c);
    if (!pixel || !frame.found_with.inImage(*pixel)) continue;
    const auto normalized = frame.by_now.camera->undistort(*pixel);
    if (!normalized) return std::nullopt;
    PlanePoint& point = points.of_grid[points.count++];
    point = {.p_m = p_m, .pixel = *pixel, .normalized = *normalized, .J_lens = {}};
    (void)frame.by_now.camera->distort(*normalized, &point.J_lens);
    const double late_s = frame.readout_s * rowTime(pixel->y(), frame.found_with.height());
    point.normalized -= late_s * imageVelocity(p_c, frame.twist);
  }
  return points;
}

}  // namespace

std::optional<PoseAtPlane> seenThrough(const SeenThrough& frame, const PoseAtPlane& found,
                                       double width_m, double height_m) {
  if (nothingLearned(frame)) return found;
  constexpr int kIterations = 10;
  const auto points = pointsInView(frame, found.T_m_c.inverse(), width_m, height_m);
  if (!points) return std::nullopt;
  const auto linearize = [&](const Transform& T_m_c, PoseNormal* normal) {
    for (const PlanePoint& point : points->inView()) {
      Projection projection;
      if (!projectPoint(T_m_c, point.p_m, &projection)) return false;
      const Eigen::Vector2d r = point.J_lens * (projection.normalized - point.normalized);
      const Matrix26d J = point.J_lens * cameraJacobian(T_m_c, point.p_m, projection.J_point);
      normal->cost += r.squaredNorm();
      normal->H += J.transpose() * J;
      normal->g += J.transpose() * r;
    }
    return true;
  };
  const auto minimum = minimizePose(found.T_m_c, kIterations, linearize);
  if (!minimum) return std::nullopt;
  const Eigen::LLT<Matrix6d> llt(minimum->normal.H);
  if (llt.info() != Eigen::Success) return std::nullopt;  // hardly any of it is in view

  PoseGlobalMatrix by_camera = PoseGlobalMatrix::Zero();
  const Transform T_c_m = minimum->T.inverse();
  for (const PlanePoint& point : points->inView()) {
    Projection projection;
    if (!projectPoint(minimum->T, point.p_m, &projection)) continue;
    const Matrix26d J = point.J_lens * cameraJacobian(minimum->T, point.p_m, projection.J_point);
    by_camera.noalias() +=
        J.transpose() * (point.J_lens * cornerByCamera(frame.by_now, point.pixel, T_c_m * point.p_m,
                                                       frame.twist, frame.monotonic_ns));
  }
  by_camera = llt.solve(by_camera).eval();
  return PoseAtPlane{minimum->T, found.covariance + covarianceByCamera(frame.by_now, by_camera)};
}

}  // namespace waymark::slam
