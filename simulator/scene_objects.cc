// Things on a table: a printed sheet of markers, and a box with markers on five sides. World frame:
// on the table under the object's middle, z up.
#include <cmath>
#include <numbers>
#include <vector>

#include "simulator/scene_builders.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr double kTableHeight = 0.75;  // metres above the floor
const RoomBox kRoom{{-2.2, -2.0, -kTableHeight}, {2.2, 2.0, 2.6 - kTableHeight}};

void addTable(Scene* scene) {
  addRoom(kRoom, scene);
  const Paint wood{.mean = 118.0,
                   .contrast = 26.0,
                   .patches_per_m2 = 14.0,
                   .patch_size_m = 0.07,
                   .noise_wavelength_m = 0.1,
                   .texel_m = 0.001};
  scene->surfaces.push_back(
      makeSurface(Vector3d::Zero(), Vector3d::UnitZ(), Vector3d::UnitY(), 1.6, 1.2, wood));
}

}  // namespace

void buildSheet(const Build& build) {
  addTable(build.scene);
  constexpr double kPaperWidth = 0.210;  // A4, metres
  constexpr double kPaperHeight = 0.297;
  constexpr double kAboveTable = 0.0005;
  const Paint white{.mean = 205.0, .contrast = 2.0, .patches_per_m2 = 0.0, .texel_m = 0.001};
  const Surface paper = makeSurface({0.0, 0.0, kAboveTable}, Vector3d::UnitZ(), Vector3d::UnitY(),
                                    kPaperWidth, kPaperHeight, white);
  build.scene->surfaces.push_back(paper);

  constexpr int kColumns = 4;
  constexpr int kRows = 6;
  Random random(build.seed, 0x5348);
  for (int i = 0; i < kColumns * kRows; ++i) {
    const int column = i % kColumns;
    const int row = i / kColumns;
    const double x = (column + 0.5) * kPaperWidth / kColumns - 0.5 * kPaperWidth;
    const double y = 0.5 * kPaperHeight - (row + 0.5) * kPaperHeight / kRows;
    hangMarker(build, paper, x, y, {.roll = 0.0, .tilt = 0.0}, &random);
    build.scene->markers.back().T_w_m.p.z() = 2.0 * kAboveTable;  // printed: no gap to speak of
  }

  // Along the border, leaning in from outside: the camera looks at the border from 0.22 m.
  std::vector<Vector4d> knots;
  const double stops[][3] = {{0.07, 0.0, 0},     {0.07, 0.07, 20},    {0.065, 0.12, 55},
                             {0.0, 0.125, 90},   {-0.065, 0.12, 125}, {-0.07, 0.07, 160},
                             {-0.07, 0.0, 180},  {-0.07, -0.07, 200}, {-0.065, -0.12, 235},
                             {0.0, -0.125, 270}, {0.065, -0.12, 305}, {0.07, -0.07, 340}};
  for (const auto& s : stops) knots.emplace_back(s[0], s[1], s[2] * kTwoPi / 360.0, 0.0);
  const ClosedSpline border(knots, Vector4d(0.0, 0.0, kTwoPi, 0.0));
  const double duration = build.scene->duration_s;
  const Sway sway(build.seed, duration,
                  {.position_m = 0.012, .yaw = 0.08, .pitch = 0.06, .roll = 0.10});
  build.scene->trajectory = [=](double t) {
    const Vector4d at = border.at(t / duration);
    const Vector3d target(at.x(), at.y(), 0.0);
    const Vector3d outwards(std::cos(at.z()), std::sin(at.z()), 0.0);
    const Vector3d position = target + 0.11 * outwards + Vector3d(0.0, 0.0, 0.19);
    return cameraPose(sway.apply(viewTowards(position, target), t));
  };
}

void buildBox(const Build& build) {
  addTable(build.scene);
  const Vector3d half(0.16, 0.13, 0.12);  // metres
  const Paint cardboard{.mean = 140.0,
                        .contrast = 12.0,
                        .patches_per_m2 = 20.0,
                        .patch_size_m = 0.03,
                        .noise_wavelength_m = 0.08,
                        .texel_m = 0.001};
  const Vector3d middle(0.0, 0.0, half.z());
  const Vector3d z = Vector3d::UnitZ();
  std::vector<Surface> sides;
  for (const Vector3d& normal :
       {Vector3d(0, -1, 0), Vector3d(1, 0, 0), Vector3d(0, 1, 0), Vector3d(-1, 0, 0)}) {
    const double width = normal.x() == 0.0 ? 2.0 * half.x() : 2.0 * half.y();
    sides.push_back(makeSurface(middle + half.cwiseProduct(normal), normal, z, width,
                                2.0 * half.z(), cardboard));
  }
  sides.push_back(makeSurface(middle + half.cwiseProduct(z), z, Vector3d::UnitY(), 2.0 * half.x(),
                              2.0 * half.y(), cardboard));

  Random random(build.seed, 0x424f58);
  for (const Surface& side : sides) {
    build.scene->surfaces.push_back(side);
    for (const double y : {0.5, -0.5}) {
      for (const double x : {-0.5, 0.5}) {
        hangMarker(build, side, x * side.half_width_m, y * side.half_height_m,
                   {.roll = 0.2, .tilt = 0.02}, &random);
      }
    }
  }

  const double duration = build.scene->duration_s;
  const Sway sway(build.seed, duration,
                  {.position_m = 0.025, .yaw = 0.06, .pitch = 0.05, .roll = 0.12});
  build.scene->trajectory = [=](double t) {
    const double angle = kTwoPi * t / duration;
    const double radius = 0.62 + 0.06 * std::sin(2.0 * angle);
    const double height = 0.45 + 0.15 * std::sin(3.0 * angle + 0.5);
    const Vector3d position(radius * std::cos(angle), radius * std::sin(angle), height);
    return cameraPose(sway.apply(viewTowards(position, middle), t));
  };
}

}  // namespace waymark::simulator
