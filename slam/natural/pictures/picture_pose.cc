#include "slam/natural/pictures/picture_pose.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "slam/geometry/homography.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {
namespace {

constexpr double kCornerSigma_px = 0.5;  // of corners that matches make; only ratios depend on it

// A square on the print, around its centre, as if it were a marker. `inCamera`: where a point of
// the print is, with what counts as its depth; empty where one is less than least_depth.
template <typename InCamera>
std::optional<MarkerDetection> squareAt(double side_m, double focal_px, double least_depth,
                                        const InCamera& inCamera) {
  MarkerDetection square;
  const auto corners = markerCorners(side_m);
  const double sigma = kCornerSigma_px / focal_px;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d p = inCamera(corners[k]);
    if (!(p.z() >= least_depth)) return std::nullopt;
    square.normalized[k] = p.head<2>() / p.z();
    square.covariance[k] = sigma * sigma * Eigen::Matrix2d::Identity();
  }
  return square;
}

std::vector<PrintPoint> pointsOf(const PictureCandidate& candidate, const NaturalMarker& marker,
                                 std::span<const ImageFeature> image) {
  std::vector<PrintPoint> points;
  for (const PictureFeatureMatch& match : candidate.inliers) {
    const Eigen::Vector2d on_print =
        marker.featurePoint(static_cast<std::size_t>(match.picture_feature));
    points.push_back({{on_print.x(), on_print.y(), 0.0},
                      image[static_cast<std::size_t>(match.image_feature)].normalized});
  }
  return points;
}

}  // namespace

std::optional<MinimizedPose> poseFromPoints(const Transform& start,
                                            std::span<const PrintPoint> points, double focal_px,
                                            double kernel_px) {
  constexpr int kIterations = 15;
  const Transform camera;  // the identity: the "world" here is the camera
  return minimizePose(start, kIterations, [&](const Transform& T_c_p, PoseNormal* normal) {
    for (const PrintPoint& point : points) {
      const Eigen::Vector3d p = T_c_p * point.on_print;
      Projection projection;
      if (!projectPoint(camera, p, &projection)) return false;
      const Eigen::Vector2d r = focal_px * (projection.normalized - point.normalized);
      const Matrix26d J = focal_px * markerJacobian(T_c_p, p, projection.J_point);
      const double weight = huberWeight(r.squaredNorm(), kernel_px);
      normal->cost += huberCost(r.squaredNorm(), kernel_px);
      normal->H += weight * J.transpose() * J;
      normal->g += weight * J.transpose() * r;
    }
    return true;
  });
}

std::optional<Transform> poseFromMatches(const PictureCandidate& candidate,
                                         const NaturalMarker& marker,
                                         std::span<const ImageFeature> image, double focal_px,
                                         double kernel_px) {
  const double side_m = 0.7 * std::min(marker.width_m(), marker.height_m());
  // Of a homography only the sign of the depth means something.
  constexpr double kInFront = std::numeric_limits<double>::min();
  const auto square =
      squareAt(side_m, focal_px, kInFront, [&](const Eigen::Vector3d& corner) -> Eigen::Vector3d {
        return candidate.H * corner.head<2>().homogeneous();
      });
  if (!square) return std::nullopt;
  const auto both = estimateSquarePose(*square, side_m, focal_px);
  if (!both) return std::nullopt;
  const std::vector<PrintPoint> points = pointsOf(candidate, marker, image);
  std::optional<MinimizedPose> best;
  for (const Transform& start : both->T_c_m) {
    const auto refined = poseFromPoints(start, points, focal_px, kernel_px);
    if (!refined) continue;
    // The print is seen from its front.
    if ((refined->T.R.transpose() * refined->T.p).z() >= 0.0) continue;
    if (!best || refined->normal.cost < best->normal.cost) best = refined;
  }
  if (!best) return std::nullopt;
  return best->T;
}

std::optional<Transform> mirroredPose(const Transform& T_c_p, double size_m, double focal_px) {
  const auto square = squareAt(size_m, focal_px, kNearestDepth,
                               [&](const Eigen::Vector3d& corner) { return T_c_p * corner; });
  if (!square) return std::nullopt;
  return otherSquarePose(*square, size_m, T_c_p);
}

}  // namespace waymark::slam
