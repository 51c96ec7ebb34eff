// A board for calibration on a table, as waymark print board makes it, and a camera that a hand
// carries round it: near and far, from all sides, the board in every part of the image. World
// frame: on the board in its middle, x to its right, y to its top, z up.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "simulator/furniture.h"
#include "simulator/scene_builders.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

// A picture of 0.1 mm to the pixel.
constexpr double kPixel_m = 1e-4;
constexpr int kColumns = 7;
constexpr int kRows = 10;
constexpr int kSquare_px = 250;
constexpr int kMarker_px = 180;
constexpr int kMargin_px = 150;

void fillSquare(PosterImage* page, int left, int top, int side, std::uint8_t grey) {
  for (int y = top; y < top + side; ++y) {
    const auto begin = page->grey.begin() + static_cast<std::ptrdiff_t>(y) * page->width + left;
    std::fill_n(begin, side, grey);
  }
}

// Cell edges that are no whole pixels are rounded: less than 0.05 mm.
void drawMarker(const slam::Dictionary& dictionary, int id, int left, int top, PosterImage* page) {
  const double cell_px = static_cast<double>(kMarker_px) / dictionary.cells();
  for (int y = 0; y < kMarker_px; ++y) {
    for (int x = 0; x < kMarker_px; ++x) {
      const int row = static_cast<int>((y + 0.5) / cell_px);
      const int column = static_cast<int>((x + 0.5) / cell_px);
      const bool white = dictionary.white(id, row, column);
      page->grey[static_cast<std::size_t>(top + y) * static_cast<std::size_t>(page->width) +
                 static_cast<std::size_t>(left + x)] = white ? 255 : 0;
    }
  }
}

PosterImage drawBoard(bool with_markers) {
  PosterImage page{kColumns * kSquare_px + 2 * kMargin_px, kRows * kSquare_px + 2 * kMargin_px, {}};
  page.grey.assign(static_cast<std::size_t>(page.width) * static_cast<std::size_t>(page.height),
                   255);
  const slam::Dictionary dictionary = *slam::Dictionary::byName("5X5_100");
  int id = 0;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const int left = kMargin_px + column * kSquare_px;
      const int top = kMargin_px + row * kSquare_px;
      constexpr int kInset = (kSquare_px - kMarker_px) / 2;
      if ((row + column) % 2 == 0) {
        fillSquare(&page, left, top, kSquare_px, 0);
      } else if (with_markers) {
        drawMarker(dictionary, id++, left + kInset, top + kInset, &page);
      }
    }
  }
  return page;
}

// Round the board at two heights, tilted by 15 to 45 degrees; what is looked at goes round, too, so
// that the board comes into all corners of the image.
Trajectory walk(const Build& build) {
  constexpr double kWay_s = 66.0;
  constexpr int kStops = 30;
  std::vector<Vector4d> eye;
  std::vector<Vector4d> target;
  for (int i = 0; i < kStops; ++i) {
    const double part = static_cast<double>(i) / kStops;
    const double round = 2.0 * std::numbers::pi * 3.0 * part;
    const double tilt = 0.25 + 0.55 * (0.5 + 0.5 * std::sin(2.0 * std::numbers::pi * 5.0 * part));
    const double distance = 0.36 + 0.12 * std::cos(2.0 * std::numbers::pi * 7.0 * part);
    eye.emplace_back(distance * std::sin(tilt) * std::cos(round),
                     distance * std::sin(tilt) * std::sin(round), distance * std::cos(tilt), 0.0);
    const double looking = 2.0 * std::numbers::pi * 11.0 * part;
    target.emplace_back(0.11 * std::cos(looking), 0.09 * std::sin(looking), 0.0, 0.0);
  }
  const WayTime time(build, kWay_s);
  const ClosedSpline eyes(eye, Vector4d::Zero());
  const ClosedSpline targets(target, Vector4d::Zero());
  const Sway sway(build.seed, kWay_s,
                  {.position_m = 0.01, .yaw = 0.02, .pitch = 0.02, .roll = 0.25});
  return [=](double t) {
    const double now = time.at(t);
    const View view =
        viewTowards(eyes.at(now / kWay_s).head<3>(), targets.at(now / kWay_s).head<3>());
    return cameraPose(sway.apply(view, now));
  };
}

void buildBoardScene(const Build& build, bool with_markers) {
  const Paint wood{.mean = 140.0,
                   .contrast = 14.0,
                   .patches_per_m2 = 0.0,
                   .noise_wavelength_m = 0.08,
                   .texel_m = 0.001};
  const Surface table =
      makeSurface({0.0, 0.0, -0.002}, Vector3d::UnitZ(), Vector3d::UnitY(), 3.0, 3.0, wood);
  build.scene->surfaces.push_back(table);
  const PosterImage page = drawBoard(with_markers);
  build.scene->prints.push_back(makePrint(page, kPixel_m * page.width, table, {0.0, 0.0}, 0.0));
  build.scene->trajectory = walk(build);
}

}  // namespace

void buildBoard(const Build& build) { buildBoardScene(build, true); }

void buildChessboard(const Build& build) { buildBoardScene(build, false); }

}  // namespace waymark::simulator
