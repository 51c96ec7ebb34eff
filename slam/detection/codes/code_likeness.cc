#include "slam/detection/codes/code_likeness.h"

#include <algorithm>
#include <cassert>
#include <cstddef>

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace waymark::slam {
namespace {

// A level without the print, its change across and down, the print's cells, and by how much those
// around a cell differ from it.
constexpr int kLight = 3;
constexpr int kUnknowns = kLight + 2;

// The paper around the border is white.
double whiteness(const Dictionary& dictionary, int id, int row, int column) {
  const int cells = dictionary.cells();
  const bool outside = row < 0 || column < 0 || row >= cells || column >= cells;
  return outside || dictionary.white(id, row, column) ? 1.0 : 0.0;
}

Eigen::Matrix<double, kUnknowns, 1> regressors(const Dictionary& dictionary, int id, int row,
                                               int column) {
  const auto at = [&](int r, int c) { return whiteness(dictionary, id, r, c); };
  const double middle = 0.5 * (dictionary.cells() - 1);
  const double own = at(row, column);
  const double around = 0.25 * (at(row - 1, column) + at(row + 1, column) + at(row, column - 1) +
                                at(row, column + 1));
  return {1.0, column - middle, row - middle, own, around - own};
}

}  // namespace

// Least squares twice: with the light alone, and with the print.
double codeLikeness(const Dictionary& dictionary, int id, std::span<const float> levels,
                    double variance) {
  const int cells = dictionary.cells();
  assert(levels.size() == static_cast<std::size_t>(cells * cells));
  using Normal = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  Normal A = Normal::Zero();
  Eigen::Matrix<double, kUnknowns, 1> b = Eigen::Matrix<double, kUnknowns, 1>::Zero();
  double squares = 0.0;
  std::size_t next = 0;
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      const auto x = regressors(dictionary, id, row, column);
      const double level = levels[next++];
      A += x * x.transpose();
      b += level * x;
      squares += level * level;
    }
  }
  const Eigen::Matrix<double, kUnknowns, 1> with_print = A.ldlt().solve(b);
  if (!(with_print[kLight] > 0.0)) return 0.0;
  const Eigen::Matrix3d of_light = A.topLeftCorner<kLight, kLight>();
  const Eigen::Vector3d by_light = b.head<kLight>();
  const double noise = (static_cast<double>(levels.size()) - kUnknowns) * variance;
  const double rest = std::max(squares - b.dot(with_print) - noise, 0.0);
  const double all = squares - by_light.dot(of_light.ldlt().solve(by_light)) - noise;
  return all > 0.0 ? std::max(1.0 - rest / all, 0.0) : 0.0;
}

}  // namespace waymark::slam
