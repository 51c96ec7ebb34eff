#include "tools/calibration/camera_solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"
#include "tools/calibration/board_pose.h"

namespace waymark::calibration {
namespace {

using slam::Calibration;
using slam::CameraModel;
using slam::Matrix6d;
using slam::Transform;
using slam::Vector6d;

constexpr Eigen::Index kPinhole = 4;  // fx fy cx cy, the first of every lens's parameters
constexpr double kNearest = 1e-6;     // metres in front of the camera

Eigen::Index coefficientCount(Lens lens) {
  return lens == Lens::kPlumbBob ? 5 : (lens == Lens::kRational ? 8 : 4);
}

// One view's part of the normal equations, by the parameters (a) and by its pose (b).
struct ViewNormal {
  Eigen::MatrixXd A;  // a a
  Eigen::MatrixXd C;  // a b
  Matrix6d B;         // b b
  Eigen::VectorXd a;
  Vector6d b;
  double cost = 0.0;
};

// A camera and where the board is in each view.
struct State {
  Calibration camera;
  std::vector<Transform> T_c_b;
};

class Problem {
 public:
  Problem(const std::vector<Eigen::Vector3d>& board, std::span<const std::vector<BoardPoint>> views,
          Lens lens, double huber_sigmas)
      : board_(board), views_(views), lens_(lens), huber_sigmas_(huber_sigmas) {}

  [[nodiscard]] Lens lens() const { return lens_; }
  [[nodiscard]] std::size_t views() const { return views_.size(); }
  void setNoise(double noise) { noise_ = noise; }

  // Empty where a point is behind the camera.
  [[nodiscard]] std::optional<std::vector<ViewNormal>> linearize(const State& state) const {
    const CameraModel camera(state.camera);
    std::vector<ViewNormal> normals;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      auto normal = linearize(camera, state.T_c_b[v], views_[v]);
      if (!normal) return std::nullopt;
      normals.push_back(std::move(*normal));
    }
    return normals;
  }

  [[nodiscard]] std::optional<double> cost(const State& state) const {
    const CameraModel camera(state.camera);
    double sum = 0.0;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      for (const BoardPoint& point : views_[v]) {
        const Eigen::Vector3d p = state.T_c_b[v] * board_[point.index];
        if (p.z() < kNearest) return std::nullopt;
        const Eigen::Vector2d r = camera.distort(p.head<2>() / p.z()) - point.pixel;
        sum += slam::huberCost(whitened(point, r).squaredNorm(), threshold());
      }
    }
    return sum;
  }

  // Projected less seen, pixels, view by view.
  [[nodiscard]] std::vector<std::vector<Eigen::Vector2d>> residuals(const State& state) const {
    const CameraModel camera(state.camera);
    std::vector<std::vector<Eigen::Vector2d>> all(views_.size());
    for (std::size_t v = 0; v < views_.size(); ++v) {
      for (const BoardPoint& point : views_[v]) {
        const Eigen::Vector3d p = state.T_c_b[v] * board_[point.index];
        all[v].push_back(camera.distort(p.head<2>() / p.z()) - point.pixel);
      }
    }
    return all;
  }

  // Standard deviation of whitened residuals, from their median.
  [[nodiscard]] double robustNoise(const State& state) const {
    constexpr double kMedianOfChi2With2 = 1.386;
    constexpr double kMin = 1e-3;
    const auto all = residuals(state);
    std::vector<double> squared;
    for (std::size_t v = 0; v < views_.size(); ++v) {
      for (std::size_t i = 0; i < views_[v].size(); ++i) {
        squared.push_back(whitened(views_[v][i], all[v][i]).squaredNorm());
      }
    }
    return std::max(kMin, std::sqrt(slam::median(std::move(squared)) / kMedianOfChi2With2));
  }

 private:
  [[nodiscard]] double threshold() const { return huber_sigmas_ * noise_; }

  static Eigen::Vector2d whitened(const BoardPoint& point, const Eigen::Vector2d& residual) {
    return slam::whitening(point.covariance) * residual;
  }

  [[nodiscard]] std::optional<ViewNormal> linearize(const CameraModel& camera, const Transform& T,
                                                    const std::vector<BoardPoint>& points) const {
    const Eigen::Index n = kPinhole + coefficientCount(lens_);
    ViewNormal normal{Eigen::MatrixXd::Zero(n, n),
                      Eigen::MatrixXd::Zero(n, 6),
                      Matrix6d::Zero(),
                      Eigen::VectorXd::Zero(n),
                      Vector6d::Zero(),
                      0.0};
    for (const BoardPoint& point : points) {
      const Eigen::Vector3d turned = T.R * board_[point.index];
      const Eigen::Vector3d p = turned + T.p;
      if (p.z() < kNearest) return std::nullopt;
      const Eigen::Vector2d normalized = p.head<2>() / p.z();
      Eigen::Matrix2d D;
      const Eigen::Matrix2d W = slam::whitening(point.covariance);
      const Eigen::Vector2d r = W * (camera.distort(normalized, &D) - point.pixel);
      Eigen::Matrix<double, 2, 3> J_point;
      J_point << 1.0 / p.z(), 0.0, -p.x() / (p.z() * p.z()),  //
          0.0, 1.0 / p.z(), -p.y() / (p.z() * p.z());
      Eigen::Matrix<double, 2, 6> J_pose;
      J_pose << J_point, -J_point * slam::skew(turned);
      J_pose = W * D * J_pose;
      const Eigen::Matrix2Xd J = W * parameterJacobian(camera, lens_, normalized);
      const double weight = slam::huberWeight(r.squaredNorm(), threshold());
      normal.A += weight * J.transpose() * J;
      normal.C += weight * J.transpose() * J_pose;
      normal.B += weight * J_pose.transpose() * J_pose;
      normal.a += weight * J.transpose() * r;
      normal.b += weight * J_pose.transpose() * r;
      normal.cost += slam::huberCost(r.squaredNorm(), threshold());
    }
    return normal;
  }

  const std::vector<Eigen::Vector3d>& board_;
  std::span<const std::vector<BoardPoint>> views_;
  Lens lens_;
  double huber_sigmas_;
  double noise_ = 1.0;
};

double costOf(const std::vector<ViewNormal>& normals) {
  double cost = 0.0;
  for (const ViewNormal& normal : normals) cost += normal.cost;
  return cost;
}

// The equations of the parameters with the poses eliminated; `damping` as in Levenberg-Marquardt.
struct Reduced {
  Eigen::MatrixXd S;
  Eigen::VectorXd s;
  std::vector<Eigen::VectorXd> pulls;  // each view's part of s
};

Reduced reduce(const std::vector<ViewNormal>& normals, double damping) {
  const Eigen::Index n = normals.front().A.rows();
  Reduced reduced{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n), {}};
  for (const ViewNormal& normal : normals) {
    Matrix6d B = normal.B;
    B.diagonal() *= 1.0 + damping;
    const Eigen::LDLT<Matrix6d> solver(B);
    const Eigen::MatrixXd C_over_B = solver.solve(normal.C.transpose()).transpose();
    reduced.S += normal.A - C_over_B * normal.C.transpose();
    reduced.S.diagonal() += damping * normal.A.diagonal();
    reduced.pulls.emplace_back(normal.a - C_over_B * normal.b);
    reduced.s += reduced.pulls.back();
  }
  return reduced;
}

// The step of the first `free` parameters and of the poses.
State stepped(const State& state, const std::vector<ViewNormal>& normals, Lens lens,
              Eigen::Index free, double damping) {
  const Reduced reduced = reduce(normals, damping);
  Eigen::VectorXd step = Eigen::VectorXd::Zero(reduced.s.size());
  step.head(free) = -reduced.S.topLeftCorner(free, free).ldlt().solve(reduced.s.head(free));
  State next = state;
  next.camera = withParameters(state.camera, lens, parametersOf(state.camera, lens) + step);
  for (std::size_t v = 0; v < normals.size(); ++v) {
    const ViewNormal& normal = normals[v];
    const Vector6d pull = normal.b + normal.C.transpose() * step;
    next.T_c_b[v] = state.T_c_b[v].retract(slam::dampedStep({normal.B, pull, 0.0}, damping));
  }
  return next;
}

bool usable(const State& state) {
  if (!state.camera.invalidReason().empty()) return false;
  return std::all_of(state.T_c_b.begin(), state.T_c_b.end(),
                     [](const Transform& T) { return T.p.allFinite() && T.R.allFinite(); });
}

// Of the first `free` parameters; the others stay.
void minimize(const Problem& problem, Eigen::Index free, int max_iterations, State* state) {
  constexpr double kConverged = 1e-9;  // relative fall of the cost
  constexpr double kHopeless = 1e10;   // damping beyond which no step will help
  auto normals = problem.linearize(*state);
  if (!normals) return;
  double damping = 1e-4;
  for (int i = 0; i < max_iterations && damping < kHopeless; ++i) {
    const double before = costOf(*normals);
    const State next = stepped(*state, *normals, problem.lens(), free, damping);
    const auto after = usable(next) ? problem.cost(next) : std::nullopt;
    if (!after || !(*after <= before)) {
      damping *= 10.0;
      continue;
    }
    *state = next;
    if (before - *after <= kConverged * before) return;
    normals = problem.linearize(*state);
    if (!normals) return;
    damping = std::max(0.1 * damping, 1e-12);
  }
}

Calibration blankCamera(int width, int height, Lens lens, double focal_px) {
  Calibration camera = roughCalibration(width, height);
  camera.fx = camera.fy = focal_px;
  camera.model = lens == Lens::kEquidistant ? slam::DistortionModel::kEquidistant
                                            : slam::DistortionModel::kRational;
  return camera;
}

// The undistorted camera, of many focal lengths, that explains the views best. A view that one of
// them cannot have seen counts as badly as can be.
std::optional<State> firstGuess(const std::vector<Eigen::Vector3d>& board,
                                std::span<const std::vector<BoardPoint>> views, int width,
                                int height, Lens lens) {
  constexpr double kShortest = 0.2;  // of the picture's width
  constexpr double kRatio = 1.15;
  constexpr int kLengths = 27;  // up to 7.6
  const double unseen_px = 0.1 * width;
  std::optional<State> best;
  double best_cost = std::numeric_limits<double>::infinity();
  double focal = kShortest;
  for (int i = 0; i < kLengths; ++i, focal *= kRatio) {
    State state{blankCamera(width, height, lens, focal * width), {}};
    const CameraModel camera(state.camera);
    double cost = 0.0;
    std::size_t seen = 0;
    for (const auto& view : views) {
      const auto pose = boardPose(board, view, camera);
      state.T_c_b.push_back(pose ? pose->T_c_b : Transform{});
      cost += pose ? std::min(pose->rms_px, unseen_px) : unseen_px;
      if (pose) ++seen;
    }
    if (seen != views.size() || cost >= best_cost) continue;
    best = std::move(state);
    best_cost = cost;
  }
  return best;
}

// Sandwich: what each view as a whole pulls, where a view's errors go together.
Eigen::MatrixXd clusteredCovariance(const Reduced& reduced, const Eigen::MatrixXd& inverse) {
  Eigen::MatrixXd pulls = Eigen::MatrixXd::Zero(inverse.rows(), inverse.cols());
  for (const Eigen::VectorXd& pull : reduced.pulls) pulls += pull * pull.transpose();
  const auto views = static_cast<double>(reduced.pulls.size());
  return views / std::max(1.0, views - 1.0) * inverse * pulls * inverse;
}

struct Covariances {
  Eigen::MatrixXd of_each;   // Solution::covariance
  Eigen::MatrixXd together;  // Solution::joint_covariance
};

// Infinite where the equations have no solution.
Covariances covariancesOf(const std::vector<ViewNormal>& normals, double noise) {
  constexpr double kSingular = 1e-14;
  const Reduced reduced = reduce(normals, 0.0);
  const Eigen::Index n = reduced.S.rows();
  // Scaled to ones on the diagonal, so that pixels and coefficients can be compared.
  const Eigen::VectorXd scale = reduced.S.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * reduced.S * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  if (!(eigen.eigenvalues()[0] > kSingular)) {
    const double none = std::numeric_limits<double>::infinity();
    return {Eigen::MatrixXd::Constant(n, n, none), Eigen::MatrixXd::Constant(n, n, none)};
  }
  const Eigen::MatrixXd scaled_inverse = eigen.eigenvectors() *
                                         eigen.eigenvalues().cwiseInverse().asDiagonal() *
                                         eigen.eigenvectors().transpose();
  const Eigen::MatrixXd inverse = scale.asDiagonal() * scaled_inverse * scale.asDiagonal();
  const Eigen::MatrixXd independent = noise * noise * inverse;
  const Eigen::MatrixXd clustered = clusteredCovariance(reduced, inverse);
  // Of each parameter the larger one: the correlations are the clustered ones'.
  const Eigen::VectorXd ratios =
      clustered.diagonal().cwiseQuotient(independent.diagonal().cwiseMax(1e-300));
  const Eigen::VectorXd growth = ratios.cwiseMax(1e-300).cwiseInverse().cwiseMax(1.0).cwiseSqrt();
  return {growth.asDiagonal() * clustered * growth.asDiagonal(),
          std::max(1.0, ratios.mean()) * independent};
}

double rms(double squared, std::size_t count) {
  return count == 0 ? 0.0 : std::sqrt(squared / static_cast<double>(count));
}

Solution solutionOf(const Problem& problem, const State& state, const std::vector<ViewNormal>& n,
                    double noise) {
  Solution solution;
  solution.camera = state.camera;
  solution.lens = problem.lens();
  solution.noise = noise;
  Covariances covariances = covariancesOf(n, noise);
  solution.covariance = std::move(covariances.of_each);
  solution.joint_covariance = std::move(covariances.together);
  auto residuals = problem.residuals(state);
  double squared = 0.0;
  std::size_t count = 0;
  for (std::size_t v = 0; v < residuals.size(); ++v) {
    double of_view = 0.0;
    for (const Eigen::Vector2d& r : residuals[v]) of_view += r.squaredNorm();
    squared += of_view;
    count += residuals[v].size();
    const double rms_px = rms(of_view, residuals[v].size());
    solution.views.push_back({state.T_c_b[v], std::move(residuals[v]), rms_px});
  }
  solution.rms_px = rms(squared, count);
  return solution;
}

}  // namespace

std::vector<std::string> parameterNames(Lens lens) {
  std::vector<std::string> names = {"fx", "fy", "cx", "cy", "k1", "k2"};
  const std::vector<std::string> rest =
      lens == Lens::kEquidistant ? std::vector<std::string>{"k3", "k4"}
                                 : std::vector<std::string>{"p1", "p2", "k3", "k4", "k5", "k6"};
  names.insert(names.end(), rest.begin(), rest.begin() + (coefficientCount(lens) - 2));
  return names;
}

Eigen::VectorXd parametersOf(const Calibration& camera, Lens lens) {
  Eigen::VectorXd v(kPinhole + coefficientCount(lens));
  v.head<4>() << camera.fx, camera.fy, camera.cx, camera.cy;
  for (Eigen::Index i = 0; i < coefficientCount(lens); ++i) {
    v[kPinhole + i] = camera.distortion[static_cast<std::size_t>(i)];
  }
  return v;
}

Calibration withParameters(Calibration camera, Lens lens, const Eigen::VectorXd& parameters) {
  camera.fx = parameters[0];
  camera.fy = parameters[1];
  camera.cx = parameters[2];
  camera.cy = parameters[3];
  for (Eigen::Index i = 0; i < coefficientCount(lens); ++i) {
    camera.distortion[static_cast<std::size_t>(i)] = parameters[kPinhole + i];
  }
  return camera;
}

Eigen::Matrix2Xd parameterJacobian(const CameraModel& camera, Lens lens,
                                   const Eigen::Vector2d& normalized) {
  const Eigen::Index n = kPinhole + coefficientCount(lens);
  Eigen::Matrix2Xd J(2, n);
  const slam::IntrinsicJacobian first = camera.intrinsicJacobian(normalized);
  J.leftCols(std::min<Eigen::Index>(n, first.cols())) =
      first.leftCols(std::min<Eigen::Index>(n, first.cols()));
  if (lens != Lens::kRational) return J;
  // d (num / den) / d k4 = -num / den^2 r^2, and so on.
  const auto& d = camera.calibration().distortion;
  const double r2 = normalized.squaredNorm();
  const double num = 1.0 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  const double den = 1.0 + r2 * (d[5] + r2 * (d[6] + r2 * d[7]));
  const Eigen::Vector2d scaled(camera.calibration().fx * normalized.x(),
                               camera.calibration().fy * normalized.y());
  double power = r2;
  for (Eigen::Index column = first.cols(); column < n; ++column, power *= r2) {
    J.col(column) = -num / (den * den) * power * scaled;
  }
  return J;
}

double Solution::sigma(Eigen::Index parameter) const {
  return std::sqrt(covariance(parameter, parameter));
}

slam::Calibration Solution::measuredCamera() const {
  slam::Calibration measured = camera;
  if (!joint_covariance.allFinite()) return measured;
  constexpr Eigen::Index kIntrinsics = 9;
  const Eigen::Index n = std::min(joint_covariance.rows(), kIntrinsics);
  const Eigen::Index rest = joint_covariance.rows() - n;  // k4, k5, k6, which stay as they are
  Eigen::MatrixXd P = joint_covariance.topLeftCorner(n, n);
  if (rest > 0) {
    const Eigen::MatrixXd across = joint_covariance.topRightCorner(n, rest);
    P -= across * joint_covariance.bottomRightCorner(rest, rest).ldlt().solve(across.transpose());
  }
  measured.covariance = slam::IntrinsicMatrix::Zero();
  measured.covariance->topLeftCorner(n, n) = 0.5 * (P + P.transpose());
  return measured;
}

std::optional<Solution> solveCamera(const std::vector<Eigen::Vector3d>& board,
                                    std::span<const std::vector<BoardPoint>> views, int width,
                                    int height, Lens lens, const SolverOptions& options) {
  constexpr std::size_t kMinViews = 3;
  if (views.size() < kMinViews) return std::nullopt;
  std::optional<State> state = firstGuess(board, views, width, height, lens);
  if (!state) return std::nullopt;
  Problem problem(board, views, lens, options.huber_sigmas);
  const Eigen::Index all = kPinhole + coefficientCount(lens);
  // Focal lengths first, then the centre, then the lens: each from a place where it is nearly
  // right.
  for (const Eigen::Index free : {Eigen::Index{2}, kPinhole, kPinhole + 2, all, all}) {
    problem.setNoise(problem.robustNoise(*state));
    minimize(problem, free, options.max_iterations, &*state);
  }
  const double noise = problem.robustNoise(*state);
  problem.setNoise(noise);
  const auto normals = problem.linearize(*state);
  if (!normals) return std::nullopt;
  return solutionOf(problem, *state, *normals, noise);
}

}  // namespace waymark::calibration
