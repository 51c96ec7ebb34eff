#include "slam/optimization/schur_complement.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/bundle_scenario.h"

namespace waymark::slam {
namespace {

constexpr double kNoOutliers = 1e9;

// A wall with more markers than are solved for directly again and again, and a camera in front of
// each, that sees a few of them.
struct LargeWall : testing::BundleScenario {
  static constexpr int kRows = 18;
  static constexpr int kColumns = 18;

  LargeWall() : BundleScenario(17, 0.2, inFrontOfEach(), kRows, kColumns) {}

  static std::vector<Transform> inFrontOfEach() {
    std::mt19937 rng(17);
    std::vector<Transform> cameras;
    for (const auto& marker : testing::markerWall(kRows, kColumns, 0.5, &rng)) {
      const Eigen::Vector3d& p = marker.T_w_m.p;
      cameras.push_back(testing::lookAt(p + Eigen::Vector3d(0.2, -1.2, 0.1), p));
    }
    return cameras;
  }

  [[nodiscard]] NormalEquations linearized() const {
    const auto whitened = runToCompletion([&](Budget* a) { return whitenViews(problem, a); });
    NormalEquations equations;
    EXPECT_TRUE(runToCompletion(
        [&](Budget* a) { return linearize(problem, whitened, kNoOutliers, &equations, a); }));
    return equations;
  }
  void move(const BundleStep& step) {
    for (std::size_t c = 0; c < step.camera.size(); ++c) {
      problem.cameras[c].T = problem.cameras[c].T.retract(step.camera[c]);
    }
    for (std::size_t m = 0; m < step.marker.size(); ++m) {
      problem.markers[m].T = problem.markers[m].T.retract(step.marker[m]);
    }
  }
};

SchurComplement arranged(const BundleProblem& problem) {
  SchurComplement schur;
  (void)runToCompletion([&](Budget* a) { return schur.arrange(problem, a); });
  return schur;
}

BundleStep solved(SchurComplement* schur, const BundleProblem& problem,
                  const NormalEquations& equations, double lambda) {
  BundleStep step;
  EXPECT_TRUE(runToCompletion(
      [&](Budget* a) { return schur->solve(problem, equations, lambda, &step, a); }));
  return step;
}

double squaredNorm(const BundleStep& step) {
  double sum = 0.0;
  for (const auto* part : {&step.camera, &step.marker}) {
    for (const Vector6d& block : *part) sum += block.squaredNorm();
  }
  return sum;
}

double squaredDistance(BundleStep a, const BundleStep& b) {
  for (std::size_t c = 0; c < a.camera.size(); ++c) a.camera[c] -= b.camera[c];
  for (std::size_t m = 0; m < a.marker.size(); ++m) a.marker[m] -= b.marker[m];
  return squaredNorm(a);
}

// What the equations say that a step takes off the cost, without their damping.
double decrease(const BundleProblem& problem, const NormalEquations& equations,
                const BundleStep& step) {
  double sum = 0.0;
  for (std::size_t c = 0; c < step.camera.size(); ++c) {
    sum -= step.camera[c].dot(equations.g_camera[c] + 0.5 * equations.H_camera[c] * step.camera[c]);
  }
  for (std::size_t m = 0; m < step.marker.size(); ++m) {
    sum -= step.marker[m].dot(equations.g_marker[m] + 0.5 * equations.H_marker[m] * step.marker[m]);
  }
  for (std::size_t o = 0; o < problem.ties(); ++o) {
    const auto [camera, marker] = problem.tie(o);
    sum -= step.camera[static_cast<std::size_t>(camera)].dot(
        equations.H_cross[o] * step.marker[static_cast<std::size_t>(marker)]);
  }
  return sum;
}

// From the second iteration on the first one's factor serves, at other poses and another damping:
// not the same numbers, and as good a step.
TEST(SchurComplement, AKeptFactorGivesAsGoodAStep) {
  LargeWall wall;
  SchurComplement kept = arranged(wall.problem);
  wall.move(solved(&kept, wall.problem, wall.linearized(), 1e-3));
  for (const double lambda : {1e-3, 3e-4, 1e-4}) {
    SCOPED_TRACE(lambda);
    const NormalEquations equations = wall.linearized();
    SchurComplement fresh = arranged(wall.problem);
    const BundleStep direct = solved(&fresh, wall.problem, equations, lambda);
    const BundleStep step = solved(&kept, wall.problem, equations, lambda);
    EXPECT_NE(step.camera, direct.camera) << "it was made anew";
    // A step of 0.1 mm is within the noise, whichever way it goes.
    EXPECT_LT(squaredDistance(step, direct), 1e-4 * squaredNorm(direct) + 1e-6);
    const double best = decrease(wall.problem, equations, direct);
    EXPECT_GT(best, 0.0);
    EXPECT_NEAR(decrease(wall.problem, equations, step), best, 1e-3 * best + 0.02);
    wall.move(step);
  }
}

// A damping that left little of the ties between poses: conjugate gradients would take for ever.
TEST(SchurComplement, AFactorThatIsTooFarIsMadeAnew) {
  LargeWall wall;
  const NormalEquations equations = wall.linearized();
  SchurComplement kept = arranged(wall.problem);
  (void)solved(&kept, wall.problem, equations, 1e9);
  const BundleStep step = solved(&kept, wall.problem, equations, 1e-6);
  SchurComplement fresh = arranged(wall.problem);
  const BundleStep direct = solved(&fresh, wall.problem, equations, 1e-6);
  EXPECT_EQ(step.camera, direct.camera);
  EXPECT_EQ(step.marker, direct.marker);
}

// Cut into slices of any size, it is the same computation.
TEST(SchurComplement, SlicesChangeNothing) {
  LargeWall wall;
  SchurComplement whole = arranged(wall.problem);
  SchurComplement sliced = arranged(wall.problem);
  for (int iteration = 0; iteration < 2; ++iteration) {
    const NormalEquations equations = wall.linearized();
    const BundleStep expected = solved(&whole, wall.problem, equations, 1e-3);
    BundleStep step;
    SlicedTask<bool> task(
        [&](Budget* a) { return sliced.solve(wall.problem, equations, 1e-3, &step, a); });
    int slices = 1;
    while (!task.advance(50.0)) ++slices;
    EXPECT_GT(slices, 10);
    ASSERT_TRUE(task.take());
    EXPECT_EQ(step.camera, expected.camera);
    EXPECT_EQ(step.marker, expected.marker);
    wall.move(step);
  }
}

}  // namespace
}  // namespace waymark::slam
