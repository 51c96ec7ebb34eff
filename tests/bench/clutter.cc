#include "tests/bench/clutter.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include <Eigen/LU>

#include "slam/geometry/homography.h"
#include "tests/bench/develop.h"

namespace waymark::bench {
namespace {

int uniformInt(int low, int high, simulator::Random* random) {
  return static_cast<int>(random->uniform(low, high + 1));
}

}  // namespace

ClutterPainter::ClutterPainter(int width, int height, int marker_cells, double noise_sigma)
    : width_(width),
      height_(height),
      marker_cells_(marker_cells),
      noise_sigma_(noise_sigma),
      light_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)),
      pixels_(light_.size()) {}

ImageView ClutterPainter::paint(std::uint64_t seed) {
  simulator::Random random(seed);
  paintGround(&random);
  const int squares = uniformInt(30, 90, &random);
  for (int i = 0; i < squares; ++i) paintSquare(&random);
  for (int i = 0; i < 4; ++i) paintWriting(&random);
  develop(light_, width_, height_, noise_sigma_, &random, &pixels_);
  return {pixels_.data(), width_, height_, width_};
}

void ClutterPainter::paintGround(simulator::Random* random) {
  const double middle = random->uniform(60.0, 220.0);
  const double across = random->uniform(-60.0, 60.0) / width_;
  const double down = random->uniform(-60.0, 60.0) / height_;
  std::size_t i = 0;
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      light_[i++] =
          static_cast<float>(middle + across * (x - 0.5 * width_) + down * (y - 0.5 * height_));
    }
  }
}

ClutterPainter::Quad ClutterPainter::randomQuad(simulator::Random* random) const {
  const Eigen::Vector2d centre(random->uniform(0.0, width_), random->uniform(0.0, height_));
  const double half = 0.5 * std::exp(random->uniform(std::log(10.0), std::log(160.0)));
  const double turn = random->uniform(0.0, 2.0 * std::numbers::pi);
  const double foreshortening = random->uniform(0.3, 1.0);
  const double skew = random->uniform(-0.2, 0.2);
  const Eigen::Vector2d right(std::cos(turn), std::sin(turn));
  const Eigen::Vector2d down(-right.y(), right.x());
  Quad quad;
  constexpr std::array<std::array<double, 2>, 4> kCorners = {{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}};
  for (std::size_t k = 0; k < 4; ++k) {
    const auto [u, v] = kCorners[k];
    quad[k] = centre + half * (1.0 + skew * v) * (u * right + foreshortening * v * down);
  }
  return quad;
}

template <typename Level>
void ClutterPainter::fill(const Quad& quad, const Level& level) {
  const auto H = slam::homographyFromUnitSquare(quad);
  if (!H) return;
  const Eigen::Matrix3d to_square = H->inverse();
  Eigen::Vector2d low = quad[0];
  Eigen::Vector2d high = quad[0];
  for (const Eigen::Vector2d& corner : quad) {
    low = low.cwiseMin(corner);
    high = high.cwiseMax(corner);
  }
  const int left = std::max(static_cast<int>(low.x()), 0);
  const int right = std::min(static_cast<int>(high.x()) + 1, width_ - 1);
  const int top = std::max(static_cast<int>(low.y()), 0);
  const int bottom = std::min(static_cast<int>(high.y()) + 1, height_ - 1);
  for (int y = top; y <= bottom; ++y) {
    for (int x = left; x <= right; ++x) {
      const Eigen::Vector2d p = slam::applyHomography(to_square, {x, y});
      if (p.minCoeff() < 0.0 || p.maxCoeff() >= 1.0) continue;
      light_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
             static_cast<std::size_t>(x)] = static_cast<float>(level(p.x(), p.y()));
    }
  }
}

void ClutterPainter::paintSquare(simulator::Random* random) {
  const Quad quad = randomQuad(random);
  const double dark = random->uniform(5.0, 110.0);
  const double light = random->uniform(dark + 40.0, 250.0);
  const auto kind = static_cast<Kind>(uniformInt(0, kKinds - 1, random));
  int cells = uniformInt(2, kMaxCells, random);
  if (cells == marker_cells_) ++cells;
  std::array<bool, (kMaxCells + 1) * (kMaxCells + 1)> white{};
  for (bool& cell : white) cell = random->uniform(0.0, 1.0) < 0.5;
  // Most have a light ground of their own, as a print on paper.
  const double paper = random->uniform(0.0, 1.0) < 0.7 ? random->uniform(0.05, 0.2) : 0.0;
  fill(quad, [&](double u, double v) {
    u = (u - paper) / (1.0 - 2.0 * paper);
    v = (v - paper) / (1.0 - 2.0 * paper);
    if (std::min(u, v) < 0.0 || std::max(u, v) >= 1.0) return light;
    const int column = static_cast<int>(u * cells);
    const int row = static_cast<int>(v * cells);
    const bool border = std::min(row, column) == 0 || std::max(row, column) == cells - 1;
    bool is_white = false;
    switch (kind) {
      case Kind::kPlain:
        break;
      case Kind::kFrame:
        is_white = !border;
        break;
      case Kind::kCells:
        is_white = !border && white[static_cast<std::size_t>(row * kMaxCells + column)];
        break;
      case Kind::kChessboard:
        is_white = (row + column) % 2 != 0;
        break;
      case Kind::kStripes:
        is_white = !border && column % 2 != 0;
        break;
    }
    return is_white ? light : dark;
  });
}

void ClutterPainter::paintWriting(simulator::Random* random) {
  const Quad page = randomQuad(random);
  const int lines = uniformInt(3, 12, random);
  std::array<std::array<bool, 40>, 12> ink{};
  for (auto& line : ink) {
    for (bool& letter : line) letter = random->uniform(0.0, 1.0) < 0.6;
  }
  fill(page, [&](double u, double v) {
    const double y = v * lines;
    const bool within = y - std::floor(y) < 0.6;
    const bool inked = ink[static_cast<std::size_t>(y)][static_cast<std::size_t>(u * 40.0)];
    return within && inked ? 40.0 : 225.0;
  });
}

}  // namespace waymark::bench
