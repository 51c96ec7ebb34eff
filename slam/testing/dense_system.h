// All normal equations of a problem in one matrix; what is fixed is not in it.
#pragma once

#include <cstddef>
#include <vector>

#include <gtest/gtest.h>

#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/normal_equations.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam::testing {

struct DenseSystem {
  Eigen::MatrixXd H;     // without a kernel
  Eigen::VectorXd g;     // with that kernel
  std::vector<int> row;  // the first one of each marker, -1 where it is fixed
};

inline DenseSystem denseSystem(const Map& map, const MarkerOptions& options, double kernel) {
  constexpr double kNoKernel = 1e9;
  const Subproblem part =
      runToCompletion([&](Budget* a) { return buildSubproblem(map, wholeMap(map), options, a); });
  const BundleProblem& problem = part.problem;
  const auto whitened = runToCompletion([&](Budget* a) { return whitenViews(problem, a); });
  NormalEquations equations;
  NormalEquations robust;
  EXPECT_TRUE(runToCompletion(
      [&](Budget* a) { return linearize(problem, whitened, kNoKernel, &equations, a); }));
  EXPECT_TRUE(
      runToCompletion([&](Budget* a) { return linearize(problem, whitened, kernel, &robust, a); }));
  DenseSystem dense;
  int rows = 0;
  std::vector<int> of_camera;
  const auto place = [&](const BundleProblem::Pose& pose) {
    if (pose.fixed) return -1;
    rows += 6;
    return rows - 6;
  };
  for (const auto& camera : problem.cameras) of_camera.push_back(place(camera));
  for (const auto& marker : problem.markers) dense.row.push_back(place(marker));
  dense.H = Eigen::MatrixXd::Zero(rows, rows);
  dense.g = Eigen::VectorXd::Zero(rows);
  const auto add = [&](int row, int column, const Matrix6d& block) {
    if (row >= 0 && column >= 0) dense.H.block<6, 6>(row, column) += block;
  };
  const auto addPose = [&](int row, const Matrix6d& block, const Vector6d& gradient) {
    add(row, row, block);
    if (row >= 0) dense.g.segment<6>(row) = gradient;
  };
  for (std::size_t c = 0; c < problem.cameras.size(); ++c) {
    addPose(of_camera[c], equations.H_camera[c], robust.g_camera[c]);
  }
  for (std::size_t m = 0; m < problem.markers.size(); ++m) {
    addPose(dense.row[m], equations.H_marker[m], robust.g_marker[m]);
  }
  for (std::size_t o = 0; o < problem.ties(); ++o) {
    const int row = of_camera[static_cast<std::size_t>(problem.tie(o).camera)];
    const int column = dense.row[static_cast<std::size_t>(problem.tie(o).marker)];
    add(row, column, equations.H_cross[o]);
    add(column, row, equations.H_cross[o].transpose());
  }
  return dense;
}

}  // namespace waymark::slam::testing
