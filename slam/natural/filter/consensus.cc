#include "slam/natural/filter/consensus.h"

#include <algorithm>
#include <cstddef>

#include <Eigen/LU>

#include "base/vectorized.h"

namespace waymark::slam {
namespace {

// Symmetric, 2 x 2.
struct Symmetric2 {
  double xx, xy, yy;

  [[nodiscard]] bool invert(Symmetric2* out) const {
    const double determinant = xx * yy - xy * xy;
    if (!(determinant > 0.0)) return false;
    *out = {yy / determinant, -xy / determinant, xx / determinant};
    return true;
  }
};

struct Innovations {
  const double* residuals;
  const double* S;
  std::ptrdiff_t stride;

  [[nodiscard]] double at(int row, int column) const {
    return row >= column ? S[row * stride + column] : S[column * stride + row];
  }
};

// The squared distance of match j once match i is believed, whose inverse block is given.
double distanceGiven(const Innovations& in, const Symmetric2& inverse_i, int i, int j) {
  const double c00 = in.at(2 * j, 2 * i);
  const double c01 = in.at(2 * j, 2 * i + 1);
  const double c10 = in.at(2 * j + 1, 2 * i);
  const double c11 = in.at(2 * j + 1, 2 * i + 1);
  const double k00 = c00 * inverse_i.xx + c01 * inverse_i.xy;
  const double k01 = c00 * inverse_i.xy + c01 * inverse_i.yy;
  const double k10 = c10 * inverse_i.xx + c11 * inverse_i.xy;
  const double k11 = c10 * inverse_i.xy + c11 * inverse_i.yy;
  const double x = in.residuals[2 * j] - k00 * in.residuals[2 * i] - k01 * in.residuals[2 * i + 1];
  const double y =
      in.residuals[2 * j + 1] - k10 * in.residuals[2 * i] - k11 * in.residuals[2 * i + 1];
  const Symmetric2 left{in.at(2 * j, 2 * j) - k00 * c00 - k01 * c01,
                        in.at(2 * j + 1, 2 * j) - k10 * c00 - k11 * c01,
                        in.at(2 * j + 1, 2 * j + 1) - k10 * c10 - k11 * c11};
  Symmetric2 inverse{};
  if (!left.invert(&inverse)) return 1e300;
  return inverse.xx * x * x + 2.0 * inverse.xy * x * y + inverse.yy * y * y;
}

double distance(const Innovations& in, const Symmetric2& inverse, int i) {
  const double x = in.residuals[2 * i];
  const double y = in.residuals[2 * i + 1];
  return inverse.xx * x * x + 2.0 * inverse.xy * x * y + inverse.yy * y * y;
}

// row -= factor * other, n numbers.
WAYMARK_VECTORIZED void subtract(double* row, const double* other, double factor, int n) {
  for (int j = 0; j < n; ++j) row[j] -= factor * other[j];
}

}  // namespace

void findConsensus(const double* residuals, const double* S, int stride, int count, double chi2,
                   int hypotheses, std::vector<char>* marked) {
  std::fill(marked->begin(), marked->end(), char{0});
  const Innovations in{residuals, S, stride};
  const int tried = std::min(count, hypotheses);
  int best = -1;
  int best_size = 0;
  double best_sum = 0.0;
  for (int h = 0; h < tried; ++h) {
    const int i = h * count / tried;
    Symmetric2 inverse{};
    if (!Symmetric2{in.at(2 * i, 2 * i), in.at(2 * i + 1, 2 * i), in.at(2 * i + 1, 2 * i + 1)}
             .invert(&inverse)) {
      continue;
    }
    const double own = distance(in, inverse, i);
    if (own > chi2) continue;
    int size = 1;
    double sum = own;
    for (int j = 0; j < count; ++j) {
      if (j == i) continue;
      const double d = distanceGiven(in, inverse, i, j);
      if (d > chi2) continue;
      ++size;
      sum += d;
    }
    if (size > best_size || (size == best_size && sum < best_sum)) {
      best = i;
      best_size = size;
      best_sum = sum;
    }
    if (best_size == count) break;
  }
  if (best < 0) return;
  Symmetric2 inverse{};
  (void)Symmetric2{in.at(2 * best, 2 * best), in.at(2 * best + 1, 2 * best),
                   in.at(2 * best + 1, 2 * best + 1)}
      .invert(&inverse);
  for (int j = 0; j < count; ++j) {
    (*marked)[static_cast<std::size_t>(j)] =
        j == best || distanceGiven(in, inverse, best, j) <= chi2 ? 1 : 0;
  }
}

Refuter::Refuter(int max_count) : stride_(2 * max_count) {
  const auto count = static_cast<std::size_t>(max_count);
  match_.reserve(count);
  out_.reserve(count);
  information_.assign(4 * count * count, 0.0);
  weighted_.assign(2 * count, 0.0);
}

// Gauss and Jordan, in place.
bool Refuter::invert(int n) {
  const auto row = [this](int i) {
    return information_.data() + static_cast<std::ptrdiff_t>(i) * stride_;
  };
  for (int k = 0; k < n; ++k) {
    double* const pivot_row = row(k);
    const double pivot = pivot_row[k];
    if (!(pivot > 0.0)) return false;
    pivot_row[k] = 1.0;
    for (int j = 0; j < n; ++j) pivot_row[j] /= pivot;
    for (int i = 0; i < n; ++i) {
      if (i == k) continue;
      const double factor = row(i)[k];
      row(i)[k] = 0.0;
      subtract(row(i), pivot_row, factor, n);
    }
  }
  return true;
}

// What the others know without match i of those looked at.
void Refuter::leaveOut(int n, int i) {
  const double* const top = information_.data() + static_cast<std::ptrdiff_t>(2 * i) * stride_;
  const double* const bottom = top + stride_;
  Eigen::Matrix2d own;
  own << top[2 * i], top[2 * i + 1], bottom[2 * i], bottom[2 * i + 1];
  const Eigen::Matrix2d covariance = own.inverse();
  const Eigen::Vector2d gone(weighted_[static_cast<std::size_t>(2 * i)],
                             weighted_[static_cast<std::size_t>(2 * i + 1)]);
  for (int k = 0; k < n; ++k) {
    if (k / 2 == i) continue;
    double* const row = information_.data() + static_cast<std::ptrdiff_t>(k) * stride_;
    const Eigen::Vector2d gain = covariance * Eigen::Vector2d(row[2 * i], row[2 * i + 1]);
    subtract(row, top, gain.x(), n);
    subtract(row, bottom, gain.y(), n);
    weighted_[static_cast<std::size_t>(k)] -= gain.dot(gone);
  }
  out_[static_cast<std::size_t>(i)] = 1;
}

void Refuter::refute(const double* residuals, const double* S, int stride,
                     std::span<const Eigen::Matrix2d> excess, double chi2,
                     std::vector<char>* marked) {
  match_.clear();
  for (std::size_t i = 0; i < marked->size(); ++i) {
    if ((*marked)[i]) match_.push_back(static_cast<int>(i));
  }
  const int count = static_cast<int>(match_.size());
  const int n = 2 * count;
  const Innovations in{residuals, S, stride};
  const auto number = [this](int k) { return 2 * match_[static_cast<std::size_t>(k / 2)] + k % 2; };
  for (int i = 0; i < n; ++i) {
    double* const row = information_.data() + static_cast<std::ptrdiff_t>(i) * stride_;
    for (int j = 0; j < n; ++j) row[j] = in.at(number(i), number(j));
    const Eigen::Matrix2d& own =
        excess[static_cast<std::size_t>(match_[static_cast<std::size_t>(i / 2)])];
    row[i - i % 2] -= own(i % 2, 0);
    row[i - i % 2 + 1] -= own(i % 2, 1);
  }
  if (!invert(n)) return;
  for (int i = 0; i < n; ++i) {
    const double* const row = information_.data() + static_cast<std::ptrdiff_t>(i) * stride_;
    double sum = 0.0;
    for (int j = 0; j < n; ++j) sum += row[j] * residuals[number(j)];
    weighted_[static_cast<std::size_t>(i)] = sum;
  }
  out_.assign(match_.size(), char{0});
  for (int left = count; left > 1; --left) {
    // With the information Q of all, match i is off the others' forecast by Q_ii^-1 (Q r)_i, which
    // has covariance Q_ii^-1.
    int worst = -1;
    double farthest = chi2;
    for (int i = 0; i < count; ++i) {
      if (out_[static_cast<std::size_t>(i)]) continue;
      const double* const row =
          information_.data() + static_cast<std::ptrdiff_t>(2 * i) * stride_ + 2 * i;
      Symmetric2 covariance{};
      if (!Symmetric2{row[0], row[1], row[stride_ + 1]}.invert(&covariance)) continue;
      const double x = weighted_[static_cast<std::size_t>(2 * i)];
      const double y = weighted_[static_cast<std::size_t>(2 * i + 1)];
      const double d = covariance.xx * x * x + 2.0 * covariance.xy * x * y + covariance.yy * y * y;
      if (d <= farthest) continue;
      farthest = d;
      worst = i;
    }
    if (worst < 0) return;
    (*marked)[static_cast<std::size_t>(match_[static_cast<std::size_t>(worst)])] = 0;
    leaveOut(n, worst);
  }
}

}  // namespace waymark::slam
