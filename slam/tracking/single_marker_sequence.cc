#include "slam/tracking/single_marker_sequence.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <Eigen/Cholesky>

#include "base/elapsed.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

constexpr double kImpossible = -std::numeric_limits<double>::infinity();

// Logarithms of likelihoods, up to a common factor: of a frame's two poses (the second impossible
// where it has one), and of the steps from a frame's poses to those of the next.
using PoseLogs = std::array<double, 2>;
using StepLogs = std::array<PoseLogs, 2>;

double logSum(double a, double b) {
  const double larger = std::max(a, b);
  if (larger == kImpossible) return kImpossible;
  return larger + std::log1p(std::exp(std::min(a, b) - larger));
}

// How far the camera would have had to move, as a chi-square of 6 dimensions.
double stepChi2(const SequenceFrame& a, std::size_t i, const SequenceFrame& b, std::size_t k,
                const SingleMarkerSequenceOptions& options) {
  const double gap_s = secondsBetween(a.time_ns, b.time_ns);
  const auto variance = [&](double place, double speed) {
    return place * place + std::pow(speed * gap_s, 2);
  };
  Matrix6d S = a.covariance[i] + b.covariance[k];
  S.diagonal().head<3>().array() += variance(options.place_sigma_m, options.speed_m_s);
  S.diagonal().tail<3>().array() += variance(options.place_sigma_rad, options.turn_rad_s);
  const Vector6d step = a.T_w_c[i].localCoordinates(b.T_w_c[k]);
  const double chi2 = step.dot(S.ldlt().solve(step));
  return std::isfinite(chi2) ? std::clamp(chi2, 0.0, options.max_step_chi2) : options.max_step_chi2;
}

// One marker in neighbouring frames: the likeness of the poses says which is which, and nothing of
// which is right.
StepLogs stepOfOneTrack(const SequenceFrame& a, const SequenceFrame& b, double max_log_odds) {
  const auto turn = [&](std::size_t i, std::size_t k) {
    return rotationDistance(a.T_w_c[i].R, b.T_w_c[k].R);
  };
  const bool swapped = turn(0, 1) + turn(1, 0) < turn(0, 0) + turn(1, 1);
  const double same = swapped ? -max_log_odds : 0.0;
  const double other = swapped ? 0.0 : -max_log_odds;
  return {{{same, other}, {other, same}}};
}

// in_turn: no frame of that marker between them whose poses were not two.
StepLogs stepBetween(const SequenceFrame& a, const SequenceFrame& b, bool in_turn,
                     const SingleMarkerSequenceOptions& options) {
  const double gap_s = secondsBetween(a.time_ns, b.time_ns);
  if (gap_s < 0.0) return {};  // another recording: all the same
  const bool one_marker = a.poses == 2 && b.poses == 2 && a.marker == b.marker;
  if (one_marker && in_turn && gap_s <= options.judge.max_gap_s) {
    return stepOfOneTrack(a, b, options.judge.max_log_odds);
  }
  StepLogs logs{};
  for (std::size_t i = 0; i < static_cast<std::size_t>(a.poses); ++i) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(b.poses); ++k) {
      logs[i][k] = -0.5 * stepChi2(a, i, b, k, options);
    }
  }
  if (one_marker) {
    // The errors of the two poses mirror each other: their difference is no evidence.
    logs[0][0] = logs[1][1] = 0.5 * (logs[0][0] + logs[1][1]);
    logs[0][1] = logs[1][0] = 0.5 * (logs[0][1] + logs[1][0]);
  }
  return logs;
}

PoseLogs imageOf(const SequenceFrame& frame, double max_log_odds) {
  if (frame.poses == 1) return {0.0, kImpossible};
  return {std::clamp(frame.log_odds, -max_log_odds, max_log_odds), 0.0};
}

// Of the frames that say something.
struct Chain {
  std::vector<std::size_t> frames;
  std::vector<PoseLogs> images;
  std::vector<StepLogs> steps;  // to each from the one before; nothing of the first
};

Chain chainOf(std::span<const SequenceFrame> frames, const SingleMarkerSequenceOptions& options) {
  Chain chain;
  bool in_turn = false;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const SequenceFrame& frame = frames[i];
    if (frame.poses == 0) continue;
    if (frame.poses == 2 && frame.barrier < options.judge.min_barrier) {
      in_turn = false;
      continue;
    }
    chain.steps.push_back(chain.frames.empty()
                              ? StepLogs{}
                              : stepBetween(frames[chain.frames.back()], frame, in_turn, options));
    chain.frames.push_back(i);
    chain.images.push_back(imageOf(frame, options.judge.max_log_odds));
    in_turn = true;
  }
  return chain;
}

// So that sums over a long sequence stay small.
void normalize(PoseLogs* logs) {
  const double larger = std::max((*logs)[0], (*logs)[1]);
  for (double& log : *logs) log -= larger;
}

}  // namespace

std::string SingleMarkerSequenceOptions::invalidReason() const {
  return firstReason(
      {judge.invalidReason(),
       firstUnmet({{isNotNegative(min_pose_log_odds), "min_pose_log_odds must not be negative"},
                   {isPositive(speed_m_s), "speed_m_s must be positive"},
                   {isPositive(turn_rad_s), "turn_rad_s must be positive"},
                   {isPositive(place_sigma_m), "place_sigma_m must be positive"},
                   {isPositive(place_sigma_rad), "place_sigma_rad must be positive"},
                   {decided_ratio > 1.0, "decided_ratio must be above 1"},
                   {isPositive(max_step_chi2), "max_step_chi2 must be positive"}})});
}

std::vector<double> logOddsOfFirst(std::span<const SequenceFrame> frames,
                                   const SingleMarkerSequenceOptions& options) {
  std::vector<double> odds(frames.size(), 0.0);
  const Chain chain = chainOf(frames, options);
  const std::size_t count = chain.frames.size();
  // Each frame's poses given the frames up to it, its own image among them.
  std::vector<PoseLogs> before = chain.images;
  for (std::size_t n = 1; n < count; ++n) {
    const StepLogs& step = chain.steps[n];
    for (std::size_t k = 0; k < 2; ++k) {
      before[n][k] += logSum(before[n - 1][0] + step[0][k], before[n - 1][1] + step[1][k]);
    }
    normalize(&before[n]);
  }
  PoseLogs after = {0.0, 0.0};  // of what comes after a frame, given that it is at each pose
  for (std::size_t n = count; n-- > 0;) {
    if (n + 1 < count) {
      const StepLogs& step = chain.steps[n + 1];
      const PoseLogs next = {chain.images[n + 1][0] + after[0], chain.images[n + 1][1] + after[1]};
      for (std::size_t i = 0; i < 2; ++i) {
        after[i] = logSum(step[i][0] + next[0], step[i][1] + next[1]);
      }
      normalize(&after);
    }
    if (frames[chain.frames[n]].poses != 2) continue;
    odds[chain.frames[n]] = before[n][0] + after[0] - before[n][1] - after[1];
  }
  return odds;
}

}  // namespace waymark::slam
