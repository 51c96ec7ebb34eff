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

// In the order that they are looked at.
struct Refuter::Innovations {
  slam::Innovations all;
  std::span<const Match> matches;
  const std::vector<int>& order;

  // Which of all numbers the k-th is.
  [[nodiscard]] int number(int k) const {
    return 2 * order[static_cast<std::size_t>(k / 2)] + k % 2;
  }
  [[nodiscard]] double residual(int k) const { return all.residuals[number(k)]; }
  [[nodiscard]] double at(int i, int j) const {
    const double with_all = all.at(number(i), number(j));
    if (i / 2 != j / 2) return with_all;
    const int match = order[static_cast<std::size_t>(i / 2)];
    return with_all - matches[static_cast<std::size_t>(match)].excess(i % 2, j % 2);
  }
};

Refuter::Refuter(int max_count) : stride_(2 * max_count) {
  const auto count = static_cast<std::size_t>(max_count);
  order_.reserve(count);
  out_.reserve(count);
  information_.assign(4 * count * count, 0.0);
  weighted_.assign(2 * count, 0.0);
  common_.assign(2 * count, Eigen::Vector2d::Zero());
  gain_.assign(2 * count, Eigen::Vector2d::Zero());
}

int Refuter::sortByAge(std::span<const Match> matches, const std::vector<char>& marked) {
  order_.clear();
  for (std::size_t i = 0; i < marked.size(); ++i) {
    if (marked[i]) order_.push_back(static_cast<int>(i));
  }
  const auto age = [&](int i) { return matches[static_cast<std::size_t>(i)].age; };
  std::sort(order_.begin(), order_.end(),
            [&](int a, int b) { return age(a) != age(b) ? age(a) > age(b) : a < b; });
  if (order_.empty()) return 0;
  // Those of the same age belong together.
  const int middle = age(order_[(order_.size() - 1) / 2]);
  return static_cast<int>(std::ranges::find_if(order_, [&](int i) { return age(i) < middle; }) -
                          order_.begin());
}

// Gauss and Jordan, in place.
bool Refuter::invert(int n) {
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

// What the others know without the i-th.
void Refuter::leaveOut(int n, int i) {
  double* const top = row(2 * i);
  double* const bottom = row(2 * i + 1);
  Eigen::Matrix2d own;
  own << top[2 * i], top[2 * i + 1], bottom[2 * i], bottom[2 * i + 1];
  const Eigen::Matrix2d covariance = own.inverse();
  const Eigen::Vector2d gone(weighted_[static_cast<std::size_t>(2 * i)],
                             weighted_[static_cast<std::size_t>(2 * i + 1)]);
  for (int k = 0; k < n; ++k) {
    if (k / 2 == i) continue;
    double* const other = row(k);
    const Eigen::Vector2d gain = covariance * Eigen::Vector2d(other[2 * i], other[2 * i + 1]);
    subtract(other, top, gain.x(), n);
    subtract(other, bottom, gain.y(), n);
    other[2 * i] = other[2 * i + 1] = 0.0;
    weighted_[static_cast<std::size_t>(k)] -= gain.dot(gone);
  }
  std::fill_n(top, n, 0.0);
  std::fill_n(bottom, n, 0.0);
  weighted_[static_cast<std::size_t>(2 * i)] = weighted_[static_cast<std::size_t>(2 * i + 1)] = 0.0;
  out_[static_cast<std::size_t>(i)] = 1;
}

void Refuter::judgeTogether(int count, double chi2, std::vector<char>* marked) {
  for (int left = count; left > 1; --left) {
    // With the information Q of all, match i is off the others' forecast by Q_ii^-1 (Q r)_i, which
    // has covariance Q_ii^-1.
    int worst = -1;
    double farthest = chi2;
    for (int i = 0; i < count; ++i) {
      if (out_[static_cast<std::size_t>(i)]) continue;
      const double* const own = row(2 * i) + 2 * i;
      Symmetric2 covariance{};
      if (!Symmetric2{own[0], own[1], own[stride_ + 1]}.invert(&covariance)) continue;
      const double x = weighted_[static_cast<std::size_t>(2 * i)];
      const double y = weighted_[static_cast<std::size_t>(2 * i + 1)];
      const double d = covariance.xx * x * x + 2.0 * covariance.xy * x * y + covariance.yy * y * y;
      if (d <= farthest) continue;
      farthest = d;
      worst = i;
    }
    if (worst < 0) return;
    (*marked)[static_cast<std::size_t>(order_[static_cast<std::size_t>(worst)])] = 0;
    leaveOut(2 * count, worst);
  }
}

bool Refuter::admit(const Innovations& in, int count, double chi2) {
  const int n = 2 * count;
  Eigen::Vector2d r(in.residual(n), in.residual(n + 1));
  Eigen::Matrix2d S;
  S << in.at(n, n), in.at(n, n + 1), in.at(n + 1, n), in.at(n + 1, n + 1);
  for (int k = 0; k < n; ++k) {
    common_[static_cast<std::size_t>(k)] = {in.at(n, k), in.at(n + 1, k)};
  }
  for (int k = 0; k < n; ++k) {
    const double* const information = row(k);
    Eigen::Vector2d gain = Eigen::Vector2d::Zero();
    for (int j = 0; j < n; ++j) gain += information[j] * common_[static_cast<std::size_t>(j)];
    gain_[static_cast<std::size_t>(k)] = gain;
    S -= gain * common_[static_cast<std::size_t>(k)].transpose();
    r -= weighted_[static_cast<std::size_t>(k)] * common_[static_cast<std::size_t>(k)];
  }
  S = (0.5 * (S + S.transpose())).eval();
  std::fill_n(row(n), n + 2, 0.0);
  std::fill_n(row(n + 1), n + 2, 0.0);
  weighted_[static_cast<std::size_t>(n)] = weighted_[static_cast<std::size_t>(n + 1)] = 0.0;
  for (int k = 0; k < n; ++k) row(k)[n] = row(k)[n + 1] = 0.0;
  if (!(S(0, 0) > 0.0) || !(S.determinant() > 0.0)) return false;
  const Eigen::Matrix2d own = S.inverse();
  const Eigen::Vector2d pull = own * r;
  if (!(r.dot(pull) <= chi2)) return false;
  // The inverse of the covariance with two more rows.
  for (int k = 0; k < n; ++k) {
    const Eigen::Vector2d with = -own * gain_[static_cast<std::size_t>(k)];
    for (int j = 0; j < n; ++j) row(k)[j] -= with.dot(gain_[static_cast<std::size_t>(j)]);
    row(k)[n] = row(n)[k] = with.x();
    row(k)[n + 1] = row(n + 1)[k] = with.y();
    weighted_[static_cast<std::size_t>(k)] -= gain_[static_cast<std::size_t>(k)].dot(pull);
  }
  for (int i = 0; i < 2; ++i) {
    for (int j = 0; j < 2; ++j) row(n + i)[n + j] = own(i, j);
    weighted_[static_cast<std::size_t>(n + i)] = pull[i];
  }
  return true;
}

void Refuter::refute(const double* residuals, const double* S, int stride,
                     std::span<const Match> matches, double chi2, std::vector<char>* marked) {
  const int first = sortByAge(matches, *marked);
  const Innovations in{{residuals, S, stride}, matches, order_};
  const int n = 2 * first;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) row(i)[j] = in.at(i, j);
  }
  if (!invert(n)) return;
  for (int i = 0; i < n; ++i) {
    double sum = 0.0;
    for (int j = 0; j < n; ++j) sum += row(i)[j] * in.residual(j);
    weighted_[static_cast<std::size_t>(i)] = sum;
  }
  out_.assign(static_cast<std::size_t>(first), char{0});
  judgeTogether(first, chi2, marked);
  for (int i = first; i < static_cast<int>(order_.size()); ++i) {
    if (!admit(in, i, chi2)) {
      (*marked)[static_cast<std::size_t>(order_[static_cast<std::size_t>(i)])] = 0;
    }
  }
}

}  // namespace waymark::slam
