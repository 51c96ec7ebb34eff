#include "slam/optimization/normal_equations.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/optimization/schur_complement.h"
#include "slam/testing/bundle_scenario.h"

namespace waymark::slam {
namespace {

using Scenario = testing::BundleScenario;
constexpr double kNoKernel = 1e9;

// The problem's unknowns in one row: cameras, markers, lens.
int unknowns(const BundleProblem& problem) {
  return 6 * static_cast<int>(problem.cameras.size() + problem.markers.size()) +
         (problem.lens ? 9 : 0);
}

BundleProblem moved(const BundleProblem& problem, int unknown, double by) {
  BundleProblem other = problem;
  const auto pose = static_cast<std::size_t>(unknown / 6);
  const Vector6d step = by * Vector6d::Unit(unknown % 6);
  const std::size_t cameras = problem.cameras.size();
  if (pose < cameras) {
    other.cameras[pose].T = other.cameras[pose].T.retract(step);
  } else if (pose < cameras + problem.markers.size()) {
    other.markers[pose - cameras].T = other.markers[pose - cameras].T.retract(step);
  } else {
    IntrinsicVector intrinsics = problem.lens->camera.intrinsics();
    intrinsics[unknown - (unknowns(problem) - 9)] += by;
    other.lens->camera = CameraModel(problem.lens->camera.withIntrinsics(intrinsics));
  }
  return other;
}

std::vector<WhitenedView> whitenViews(const BundleProblem& problem) {
  return runToCompletion([&](Budget* a) { return slam::whitenViews(problem, a); });
}

bool robustCost(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                double huber, double* cost) {
  return runToCompletion(
      [&](Budget* a) { return slam::robustCost(problem, whitened, huber, cost, a); });
}

bool linearize(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
               double huber, NormalEquations* equations) {
  return runToCompletion(
      [&](Budget* a) { return slam::linearize(problem, whitened, huber, equations, a); });
}

NormalEquations linearized(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                           double huber) {
  NormalEquations equations;
  EXPECT_TRUE(linearize(problem, whitened, huber, &equations));
  return equations;
}

Eigen::VectorXd wholeGradient(const BundleProblem& problem, const NormalEquations& equations) {
  Eigen::VectorXd g(unknowns(problem));
  Eigen::Index at = 0;
  for (const auto* part : {&equations.g_camera, &equations.g_marker}) {
    for (const Vector6d& block : *part) {
      g.segment<6>(at) = block;
      at += 6;
    }
  }
  if (problem.lens) g.tail<9>() = equations.g_global.head<9>();
  return g;
}

Eigen::MatrixXd wholeMatrix(const BundleProblem& problem, const NormalEquations& equations) {
  const int size = unknowns(problem);
  const auto cameras = static_cast<int>(problem.cameras.size());
  const auto markers = static_cast<int>(problem.markers.size());
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
  const auto add = [&](int row, int column, const Eigen::MatrixXd& block) {
    H.block(row, column, block.rows(), block.cols()) += block;
    if (row != column) H.block(column, row, block.cols(), block.rows()) += block.transpose();
  };
  for (int i = 0; i < cameras + markers; ++i) {
    const bool camera = i < cameras;
    const auto at = static_cast<std::size_t>(camera ? i : i - cameras);
    add(6 * i, 6 * i, camera ? equations.H_camera[at] : equations.H_marker[at]);
    if (!problem.lens) continue;
    const auto& H_global = camera ? equations.H_camera_global : equations.H_marker_global;
    add(6 * i, size - 9, H_global[at].leftCols<9>());
  }
  for (std::size_t o = 0; o < problem.ties(); ++o) {
    const auto [camera, marker] = problem.tie(o);
    add(6 * camera, 6 * (cameras + marker), equations.H_cross[o]);
  }
  if (problem.lens) add(size - 9, size - 9, equations.H_global.topLeftCorner<9, 9>());
  return H;
}

// Steps small against each unknown: metres and radians, pixels, coefficients.
double stepOf(const BundleProblem& problem, int unknown) {
  const int lens = unknown - (unknowns(problem) - 9);
  return problem.lens && lens >= 0 && lens < 4 ? 1e-4 : 1e-6;
}

// Cameras and markers that only links tie, a little off: to first order in that, the gradient is
// that of the cost.
TEST(NormalEquations, TheGradientOfLinksMatchesFiniteDifferences) {
  std::mt19937 rng(3);
  BundleProblem problem;
  for (int i = 0; i < 2; ++i) {
    problem.cameras.push_back({testing::disturbed(Transform{}, 0.8, &rng), false});
    problem.markers.push_back({testing::disturbed(Transform{}, 0.8, &rng), false});
    problem.marker_sizes_m.push_back(0.1);
  }
  for (const auto& [camera, marker] : {std::pair{0, 0}, std::pair{0, 1}, std::pair{1, 1}}) {
    const Transform T_c_m = problem.cameras[static_cast<std::size_t>(camera)].T.inverse() *
                            problem.markers[static_cast<std::size_t>(marker)].T;
    Matrix6d information = 1e4 * Matrix6d::Identity();
    information(0, 4) = information(4, 0) = 3e3;
    information(2, 2) = 5e4;
    problem.links.push_back({camera, marker, testing::disturbed(T_c_m, 1e-3, &rng), information});
  }
  const NormalEquations equations = linearized(problem, {}, 1.0);
  const Eigen::VectorXd g = wholeGradient(problem, equations);
  const Eigen::MatrixXd H = wholeMatrix(problem, equations);
  for (int i = 0; i < g.size(); ++i) {
    double up = 0.0;
    double down = 0.0;
    ASSERT_TRUE(robustCost(moved(problem, i, 1e-6), {}, 1.0, &up));
    ASSERT_TRUE(robustCost(moved(problem, i, -1e-6), {}, 1.0, &down));
    const double unit = std::sqrt(H(i, i) * equations.cost);
    EXPECT_NEAR((up - down) / 4e-6, g[i], 5e-3 * unit) << "unknown " << i;
  }
}

// A frame that all markers are tied to, by a point and by a direction each; no relation is far from
// holding.
void addFrame(Scenario* s) {
  BundleProblem& problem = s->problem;
  const auto frame = static_cast<int>(problem.cameras.size());
  const Transform T_w_f = testing::disturbed(problem.markers[0].T, 0.3, &s->rng);
  problem.cameras.push_back({T_w_f, false});
  Vector6d gauge = Vector6d::Zero();
  gauge[5] = 1e3;
  problem.gauges.push_back({frame, gauge});
  for (std::size_t m = 0; m < problem.markers.size(); ++m) {
    const Transform T_f_m =
        T_w_f.inverse() * testing::disturbed(problem.markers[m].T, 0.01, &s->rng);
    BundleProblem::Relation point{{0.03, -0.05, 0.0}, true, {}, {50.0, 0.0, 200.0}, 0};
    point.in_frame = T_f_m * point.in_marker;
    BundleProblem::Relation direction{{0.0, 0.0, 1.0}, false, {}, {30.0, 40.0, 50.0}, 0};
    direction.in_frame = T_f_m.R * direction.in_marker;
    problem.constraints.push_back({frame, static_cast<int>(m), {point, direction}});
  }
  problem.constraint_sources = 1;
}

TEST(NormalEquations, TheGradientOfConstraintsMatchesFiniteDifferences) {
  Scenario s(6, 0.3, 3, 1, 4);
  addFrame(&s);
  const auto whitened = whitenViews(s.problem);
  constexpr double kHuber = 20.0;
  const NormalEquations equations = linearized(s.problem, whitened, kHuber);
  const Eigen::VectorXd g = wholeGradient(s.problem, equations);
  const Eigen::MatrixXd H = wholeMatrix(s.problem, equations);
  double cost = 0.0;
  ASSERT_TRUE(robustCost(s.problem, whitened, kHuber, &cost));
  EXPECT_DOUBLE_EQ(cost, equations.cost);
  for (int i = 0; i < g.size(); ++i) {
    constexpr double kStep = 1e-6;
    double up = 0.0;
    double down = 0.0;
    ASSERT_TRUE(robustCost(moved(s.problem, i, kStep), whitened, kHuber, &up));
    ASSERT_TRUE(robustCost(moved(s.problem, i, -kStep), whitened, kHuber, &down));
    const double unit = std::sqrt(H(i, i) * cost);
    EXPECT_NEAR((up - down) / (4.0 * kStep), g[i], 1e-5 * unit) << "unknown " << i;
  }
}

// Priors of all kinds, some corners beyond the kernel, with and without a lens: the gradient is
// that of the cost.
TEST(NormalEquations, TheGradientMatchesFiniteDifferences) {
  for (const bool with_lens : {false, true}) {
    Scenario s(1, 0.3, 3, 1, 4);
    s.anchor(1, Vector6d::Constant(0.01), 0.01, 0.02);
    if (with_lens) s.disturbLens(testing::staleLens(), testing::lensSigma());
    const auto whitened = whitenViews(s.problem);
    constexpr double kHuber = 20.0;
    const NormalEquations equations = linearized(s.problem, whitened, kHuber);
    const Eigen::VectorXd g = wholeGradient(s.problem, equations);
    const Eigen::MatrixXd H = wholeMatrix(s.problem, equations);
    double cost = 0.0;
    ASSERT_TRUE(robustCost(s.problem, whitened, kHuber, &cost));
    EXPECT_DOUBLE_EQ(cost, equations.cost);
    for (int i = 0; i < g.size(); ++i) {
      // k3 has no sigma: its weight of 1e16 drowns the numbers.
      if (with_lens && i == g.size() - 1) continue;
      const double step = stepOf(s.problem, i);
      double up = 0.0;
      double down = 0.0;
      ASSERT_TRUE(robustCost(moved(s.problem, i, step), whitened, kHuber, &up));
      ASSERT_TRUE(robustCost(moved(s.problem, i, -step), whitened, kHuber, &down));
      // Against what a step as long as the cost allows would change: sqrt(H_ii * cost).
      const double unit = std::sqrt(H(i, i) * cost);
      EXPECT_NEAR((up - down) / (4.0 * step), g[i], 1e-5 * unit) << "unknown " << i;
    }
  }
}

// Where all residuals are zero, J^T J is the Hessian, which is the gradient's derivative.
TEST(NormalEquations, TheMatrixMatchesFiniteDifferences) {
  for (const bool with_lens : {false, true}) {
    Scenario s(2, 0.0, 3, 1, 4);
    for (std::size_t c = 0; c < 3; ++c) s.problem.cameras[c].T = s.true_cameras[c];
    for (std::size_t m = 0; m < 4; ++m) s.problem.markers[m].T = s.true_markers[m];
    s.anchor(1, Vector6d::Zero(), 0.01, 0.02);
    if (with_lens) {
      s.disturbLens(IntrinsicVector::Zero(), testing::lensSigma());
      IntrinsicMatrix& covariance = s.problem.lens->covariance;
      covariance(8, 8) = 0.01;
      covariance(0, 1) = covariance(1, 0) = 0.99 * std::sqrt(covariance(0, 0) * covariance(1, 1));
    }
    const auto whitened = whitenViews(s.problem);
    const Eigen::MatrixXd H = wholeMatrix(s.problem, linearized(s.problem, whitened, kNoKernel));
    for (int i = 0; i < H.cols(); ++i) {
      const double step = stepOf(s.problem, i);
      const auto gradientAt = [&](double by) {
        const BundleProblem there = moved(s.problem, i, by);
        return wholeGradient(there, linearized(there, whitened, kNoKernel));
      };
      const Eigen::VectorXd column = (gradientAt(step) - gradientAt(-step)) / (2.0 * step);
      for (int j = 0; j < H.rows(); ++j) {
        EXPECT_NEAR(column[j], H(j, i), 1e-4 * std::sqrt(H(i, i) * H(j, j))) << j << ", " << i;
      }
    }
  }
}

// The step by elimination, and of the whole damped system; what is fixed stays.
struct Steps {
  BundleStep eliminated;
  Eigen::VectorXd whole;
};

Steps stepsOf(const BundleProblem& problem) {
  constexpr double kLambda = 1e-2;
  const NormalEquations equations = linearized(problem, whitenViews(problem), kNoKernel);
  Steps steps;
  SchurComplement schur;
  (void)runToCompletion([&](Budget* a) { return schur.arrange(problem, a); });
  EXPECT_TRUE(runToCompletion(
      [&](Budget* a) { return schur.solve(problem, equations, kLambda, &steps.eliminated, a); }));
  Eigen::MatrixXd H = wholeMatrix(problem, equations);
  Eigen::VectorXd g = wholeGradient(problem, equations);
  H.diagonal() *= 1.0 + kLambda;
  const std::size_t cameras = problem.cameras.size();
  for (std::size_t i = 0; i < cameras + problem.markers.size(); ++i) {
    if (!(i < cameras ? problem.cameras[i] : problem.markers[i - cameras]).fixed) continue;
    const auto row = static_cast<Eigen::Index>(6 * i);
    H.middleRows<6>(row).setZero();
    H.middleCols<6>(row).setZero();
    H.block<6, 6>(row, row).setIdentity();
    g.segment<6>(row).setZero();
  }
  steps.whole = -H.ldlt().solve(g);
  return steps;
}

void expectSamePoses(const BundleProblem& problem, const Steps& steps) {
  const int cameras = static_cast<int>(problem.cameras.size());
  const int poses = cameras + static_cast<int>(problem.markers.size());
  const double size = steps.whole.head(6 * poses).norm();
  for (int i = 0; i < poses; ++i) {
    const auto at = static_cast<std::size_t>(i < cameras ? i : i - cameras);
    const Vector6d& found = i < cameras ? steps.eliminated.camera[at] : steps.eliminated.marker[at];
    EXPECT_LT((found - steps.whole.segment<6>(6 * i)).norm(), 1e-6 * size) << i;
  }
}

// The elimination of cameras or markers, whichever are more, gives the step that the whole damped
// system has.
TEST(NormalEquations, TheSchurComplementSolvesTheWholeSystem) {
  for (const int cameras : {3, 8}) {
    for (const bool with_lens : {false, true}) {
      Scenario s(3, 0.2, cameras, 1, 5);
      s.anchor(1, Vector6d::Zero(), 0.01, 0.02);
      s.problem.markers[2].fixed = true;
      if (with_lens) {
        s.disturbLens(testing::staleLens(), testing::lensSigma());
        s.problem.lens->covariance(8, 8) = 0.01;
      }
      const Steps steps = stepsOf(s.problem);
      expectSamePoses(s.problem, steps);
      if (with_lens) {
        const auto lens = steps.whole.tail<9>();
        EXPECT_LT((steps.eliminated.globals.head<9>() - lens).norm(), 1e-6 * lens.norm());
      }
    }
  }
}

// Frames go, or stay, with the cameras.
TEST(NormalEquations, TheSchurComplementSolvesForFramesToo) {
  for (const int cameras : {3, 8}) {
    Scenario s(7, 0.2, cameras, 1, 5);
    s.anchor(1, Vector6d::Zero(), 0.01, 0.02);
    addFrame(&s);
    const Steps steps = stepsOf(s.problem);
    EXPECT_GT(steps.whole.segment<6>(6 * cameras).norm(), 1e-6);
    expectSamePoses(s.problem, steps);
  }
}

// The readout time's share, with and without a lens beside it.
TEST(NormalEquations, TheReadoutsGradientMatchesFiniteDifferences) {
  for (const bool with_lens : {false, true}) {
    Scenario s(5, 0.3, 3, 1, 4);
    if (with_lens) s.disturbLens(testing::staleLens(), testing::lensSigma());
    s.problem.shutter = BundleProblem::Shutter{};
    BundleProblem::Shutter& shutter = *s.problem.shutter;
    shutter.readout_s = 0.004;
    shutter.corrected_with_s = 0.001;
    for (std::size_t o = 0; o < s.problem.observations.size(); ++o) {
      const double x = 0.1 * static_cast<double>(o % 5) - 0.2;
      shutter.motion.push_back({Eigen::Vector2d(x, 0.1), Eigen::Vector2d(-x, 0.2),
                                Eigen::Vector2d(0.3, x), Eigen::Vector2d(-0.2, -x)});
    }
    const auto whitened = whitenViews(s.problem);
    const NormalEquations equations = linearized(s.problem, whitened, kNoKernel);
    constexpr double kStep_s = 1e-6;
    const auto costWith = [&](double longer_s) {
      BundleProblem other = s.problem;
      other.shutter->readout_s += longer_s;
      double cost = 0.0;
      EXPECT_TRUE(robustCost(other, whitened, kNoKernel, &cost));
      return cost;
    };
    const double numeric = (costWith(kStep_s) - costWith(-kStep_s)) / (4.0 * kStep_s);
    EXPECT_NEAR(numeric, equations.g_global[9], 1e-5 * std::abs(equations.g_global[9]));
    SchurComplement schur;
    (void)runToCompletion([&](Budget* a) { return schur.arrange(s.problem, a); });
    BundleStep step;
    ASSERT_TRUE(runToCompletion(
        [&](Budget* a) { return schur.solve(s.problem, equations, 0.0, &step, a); }));
    const auto covariance = schur.globalsCovariance(s.problem);
    ASSERT_TRUE(covariance);
    const double variance = (*covariance)(9, 9);
    EXPECT_GT(variance, 0.0);
    EXPECT_LT(variance, shutter.sigma_s * shutter.sigma_s);
  }
}

TEST(NormalEquations, ACornerBehindItsCameraHasNoCost) {
  Scenario s(4, 0.0, 2, 1, 2);
  s.problem.markers[0].T.p.y() = -50.0;
  const auto whitened = whitenViews(s.problem);
  NormalEquations equations;
  double cost = 0.0;
  std::vector<double> squared;
  EXPECT_FALSE(linearize(s.problem, whitened, kNoKernel, &equations));
  EXPECT_FALSE(robustCost(s.problem, whitened, kNoKernel, &cost));
  EXPECT_FALSE(
      runToCompletion([&](Budget* a) { return cornerErrors(s.problem, whitened, &squared, a); }));
}

}  // namespace
}  // namespace waymark::slam
