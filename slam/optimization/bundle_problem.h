// What a bundle adjustment is about: cameras, markers, who sees what, and what is known beforehand.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct BundleProblem {
  struct Pose {
    Transform T;  // T_w_c or T_w_m
    bool fixed = false;
  };
  struct Observation {
    int camera = 0;  // index into cameras
    int marker = 0;  // index into markers
    const MarkerDetection* detection = nullptr;
  };
  // A surveyed marker pose: (dp, dtheta) from T to the estimate has this information matrix.
  struct Prior {
    int marker = 0;  // index into markers
    Transform T_w_m;
    Matrix6d information = Matrix6d::Identity();  // 1/m^2, 1/rad^2
  };
  // A marker as seen from a camera that does not show it (MarkerLink): (dp, dtheta) of T_c_m, in
  // the camera's frame, has this information matrix. No camera has one to a marker that it
  // observes.
  struct Link {
    int camera = 0;  // index into cameras
    int marker = 0;  // index into markers
    Transform T_c_m;
    Matrix6d information = Matrix6d::Identity();  // 1/m^2, 1/rad^2
  };
  // How a marker lies to a frame that is an unknown itself (a plane, the vertical, a ruler between
  // two corners; the world is one that is fixed): some vectors of the marker's are there where the
  // frame has them (marker_relation.h). Such frames are poses among the cameras, behind those that
  // see anything. One constraint for each pair of frame and marker.
  struct Relation {
    Eigen::Vector3d in_marker = Eigen::Vector3d::Zero();  // a point, metres; or a direction
    bool is_point = false;
    Eigen::Vector3d in_frame = Eigen::Vector3d::Zero();
    Eigen::Vector3d weight = Eigen::Vector3d::Zero();  // 1 / sigma along the frame's axes; or 0
    int source = -1;  // relations of one source are one residual to the gate
  };
  struct Constraint {
    int camera = 0;  // index into cameras
    int marker = 0;  // index into markers
    std::vector<Relation> relations;
  };
  // What none of a frame's relations depends on: held where it is, so that the frame has a place.
  struct Gauge {
    int camera = 0;                           // index into cameras
    Vector6d information = Vector6d::Zero();  // of (dp, dtheta) in the frame's axes
  };

  // Intrinsics as unknowns (section 4.10), held by what the calibration says of them.
  struct Lens {
    CameraModel camera;     // the unknown, as it is now
    CameraModel seen_with;  // the one that undistorted the detections; does not change
    IntrinsicVector expected = IntrinsicVector::Zero();
    // Of expected; what has no variance stays as expected.
    IntrinsicMatrix covariance = IntrinsicMatrix::Zero();
  };

  // The readout time of a rolling shutter as an unknown (rolling_shutter.h).
  struct Shutter {
    double readout_s = 0.0;         // the unknown, as it is now
    double corrected_with_s = 0.0;  // what the detections were corrected with
    double sigma_s = 0.1;           // of corrected_with_s
    // By observation: how far each second of readout moves a corner, normalized.
    std::vector<std::array<Eigen::Vector2d, 4>> motion;
  };

  std::vector<Pose> cameras;
  std::vector<Pose> markers;
  std::vector<double> marker_sizes_m;  // as many as markers
  std::vector<Observation> observations;
  std::vector<Prior> priors;
  std::vector<Link> links;
  std::vector<Constraint> constraints;
  std::vector<Gauge> gauges;
  int constraint_sources = 0;
  double constraint_gate = 0.0;  // sigmas; 0 for none
  std::optional<Lens> lens;
  std::optional<Shutter> shutter;

  // What ties cameras to markers: the observations, behind them the links, then the constraints.
  struct Tie {
    int camera = 0;
    int marker = 0;
  };
  [[nodiscard]] std::size_t ties() const {
    return observations.size() + links.size() + constraints.size();
  }
  [[nodiscard]] Tie tie(std::size_t i) const {
    if (i < observations.size()) return {observations[i].camera, observations[i].marker};
    i -= observations.size();
    if (i < links.size()) return {links[i].camera, links[i].marker};
    const Constraint& constraint = constraints[i - links.size()];
    return {constraint.camera, constraint.marker};
  }

  // Unknowns that every observation depends on: intrinsics, then the readout time.
  static constexpr int kGlobals = 10;
  [[nodiscard]] bool hasGlobals() const { return lens || shutter; }
};

using GlobalVector = Eigen::Matrix<double, BundleProblem::kGlobals, 1>;
using GlobalMatrix = Eigen::Matrix<double, BundleProblem::kGlobals, BundleProblem::kGlobals>;
using PoseGlobalMatrix = Eigen::Matrix<double, 6, BundleProblem::kGlobals>;

}  // namespace waymark::slam
