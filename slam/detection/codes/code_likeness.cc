#include "slam/detection/codes/code_likeness.h"

#include <algorithm>
#include <cassert>

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace waymark::slam {
namespace {

// A level without the print, its change across and down, the print's cells, and by how much those
// around a cell differ from it.
constexpr int kLight = 3;
constexpr int kUnknowns = kLight + 2;

// A code has 64 bits at most: with the border ten cells a side, and the paper around them.
constexpr int kMostCells = 10;
using Whiteness = Eigen::Array<double, kMostCells + 2, kMostCells + 2, Eigen::RowMajor>;

constexpr int kMostLevels = kMostCells * kMostCells;
using Levels = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMostLevels, 1>;
// A row for each cell: what its level is made of.
using Design =
    Eigen::Matrix<double, Eigen::Dynamic, kUnknowns, Eigen::ColMajor, kMostLevels, kUnknowns>;

// From the paper's row and column on, which are white as it is.
Whiteness whitenessOf(const Dictionary& dictionary, int id) {
  Whiteness white = Whiteness::Ones();
  for (int row = 0; row < dictionary.cells(); ++row) {
    for (int column = 0; column < dictionary.cells(); ++column) {
      if (!dictionary.white(id, row, column)) white(row + 1, column + 1) = 0.0;
    }
  }
  return white;
}

Design designOf(const Dictionary& dictionary, int id) {
  const int cells = dictionary.cells();
  const Whiteness white = whitenessOf(dictionary, id);
  const double middle = 0.5 * (cells - 1);
  Design X(Eigen::Index{cells} * cells, kUnknowns);
  Eigen::Index next = 0;
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      const int r = row + 1;
      const int c = column + 1;
      const double own = white(r, c);
      const double around =
          0.25 * (white(r - 1, c) + white(r + 1, c) + white(r, c - 1) + white(r, c + 1));
      X.row(next++) << 1.0, column - middle, row - middle, own, around - own;
    }
  }
  return X;
}

}  // namespace

// Least squares twice: with the light alone, and with the print.
double codeLikeness(const Dictionary& dictionary, int id, std::span<const float> levels,
                    double variance) {
  const auto count = static_cast<Eigen::Index>(levels.size());
  assert(dictionary.cells() <= kMostCells);
  assert(count == Eigen::Index{dictionary.cells()} * dictionary.cells());
  const Design X = designOf(dictionary, id);
  const Levels y = Eigen::Map<const Eigen::VectorXf>(levels.data(), count).cast<double>();
  const Eigen::Matrix<double, kUnknowns, kUnknowns> A = X.transpose().lazyProduct(X);
  const Eigen::Matrix<double, kUnknowns, 1> b = X.transpose().lazyProduct(y);
  const Eigen::Matrix<double, kUnknowns, 1> with_print = A.ldlt().solve(b);
  if (!(with_print[kLight] > 0.0)) return 0.0;
  const Eigen::Matrix3d of_light = A.topLeftCorner<kLight, kLight>();
  const Eigen::Vector3d by_light = b.head<kLight>();
  const double squares = y.squaredNorm();
  const double noise = static_cast<double>(count - kUnknowns) * variance;
  const double rest = std::max(squares - b.dot(with_print) - noise, 0.0);
  const double all = squares - by_light.dot(of_light.ldlt().solve(by_light)) - noise;
  return all > 0.0 ? std::max(1.0 - rest / all, 0.0) : 0.0;
}

}  // namespace waymark::slam
