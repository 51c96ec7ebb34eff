#include "tools/calibration/board_pose.h"

#include <cmath>
#include <utility>

#include <Eigen/SVD>

#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/rotation.h"
#include "tools/calibration/plane_homography.h"

namespace waymark::calibration {
namespace {

using slam::Matrix6d;
using slam::Transform;

constexpr double kNearest = 1e-6;  // metres in front of the camera

// Columns of the homography into the plane z = 1 are r1, r2 and t, up to one scale.
Transform poseOf(Eigen::Matrix3d H) {
  if (H(2, 2) < 0.0) H = -H;  // the board's middle lies in front of the camera
  const double scale = 1.0 / std::sqrt(H.col(0).norm() * H.col(1).norm());
  Eigen::Matrix3d R;
  R << scale * H.col(0), scale * H.col(1), scale * scale * H.col(0).cross(H.col(1));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d nearest = svd.matrixU() * svd.matrixV().transpose();
  if (nearest.determinant() < 0.0) {
    nearest = svd.matrixU() * Eigen::Vector3d(1, 1, -1).asDiagonal() * svd.matrixV().transpose();
  }
  return {nearest, scale * H.col(2)};
}

// The pose that looks nearly the same from afar: the normal mirrored at the line of view.
Transform mirrored(const Transform& T) {
  const Eigen::Vector3d view = T.p.normalized();
  const Eigen::Vector3d normal = T.R.col(2);
  const Eigen::Vector3d other = 2.0 * normal.dot(view) * view - normal;
  return {slam::rotationBetween(normal, other) * T.R, T.p};
}

std::optional<BoardPose> refined(const std::vector<Eigen::Vector3d>& board,
                                 std::span<const BoardPoint> points,
                                 const std::vector<Eigen::Vector2d>& seen, double focal_px,
                                 const Transform& start) {
  constexpr int kIterations = 20;
  const auto linearize = [&](const Transform& T, slam::PoseNormal* normal) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d turned = T.R * board[points[i].index];
      const Eigen::Vector3d p = turned + T.p;
      if (p.z() < kNearest) return false;
      Eigen::Matrix<double, 2, 3> J_point;
      J_point << 1.0 / p.z(), 0.0, -p.x() / (p.z() * p.z()),  //
          0.0, 1.0 / p.z(), -p.y() / (p.z() * p.z());
      Eigen::Matrix<double, 2, 6> J;
      J << J_point, -J_point * slam::skew(turned);
      const Eigen::Vector2d r = p.head<2>() / p.z() - seen[i];
      normal->H += J.transpose() * J;
      normal->g += J.transpose() * r;
      normal->cost += r.squaredNorm();
    }
    return true;
  };
  const auto minimized = slam::minimizePose(start, kIterations, linearize);
  if (!minimized) return std::nullopt;
  const double mean = minimized->normal.cost / static_cast<double>(points.size());
  return BoardPose{minimized->T, focal_px * std::sqrt(mean)};
}

}  // namespace

std::optional<BoardPose> boardPose(const std::vector<Eigen::Vector3d>& board,
                                   std::span<const BoardPoint> points,
                                   const slam::CameraModel& camera) {
  std::vector<Eigen::Vector2d> on_board;
  std::vector<Eigen::Vector2d> seen;
  for (const BoardPoint& point : points) {
    const auto normalized = camera.undistort(point.pixel);
    if (!normalized) return std::nullopt;
    on_board.emplace_back(board[point.index].head<2>());
    seen.push_back(*normalized);
  }
  const auto H = fitHomography(on_board, seen);
  if (!H) return std::nullopt;
  const Transform first = poseOf(*H);
  std::optional<BoardPose> best;
  for (const Transform& start : {first, mirrored(first)}) {
    auto pose = refined(board, points, seen, camera.focalLength(), start);
    if (pose && (!best || pose->rms_px < best->rms_px)) best = std::move(pose);
  }
  return best;
}

}  // namespace waymark::calibration
