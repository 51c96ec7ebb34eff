#include "slam/natural/filter/consensus.h"

#include <algorithm>
#include <cstddef>

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

}  // namespace waymark::slam
