// A plane as a camera sees it.
#pragma once

#include <Eigen/Core>

#include "slam/geometry/transform.h"

namespace waymark::simulator {

// For the ray d = (x, y, 1) of the camera that meets the plane z = 0 of frame s at depth z and at
// (u, v): three linear forms of d give 1/z, u/z and v/z. No division is needed to decide what lies
// in front, or whether a bounded surface is hit.
struct PlaneForms {
  Eigen::Vector3f u_over_z;
  Eigen::Vector3f v_over_z;
  Eigen::Vector3f inverse_z;

  // Precondition: the camera's centre is not in the plane.
  explicit PlaneForms(const slam::Transform& T_s_c) {
    const Eigen::Vector3d w = -T_s_c.R.row(2).transpose() / T_s_c.p.z();
    inverse_z = w.cast<float>();
    u_over_z = (T_s_c.R.row(0).transpose() + T_s_c.p.x() * w).cast<float>();
    v_over_z = (T_s_c.R.row(1).transpose() + T_s_c.p.y() * w).cast<float>();
  }
};

// Nearer than this to a plane, the camera does not see it (metres).
inline constexpr double kInPlane = 1e-6;

}  // namespace waymark::simulator
