// Two rooms of 7 x 7 x 3 m side by side, joined by a door in the wall between them. World frame: on
// the floor in the middle of the doorway, x from the first room into the second, z up.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "simulator/scene_builders.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

constexpr double kHeight = 3.0;
constexpr double kDoorHalfWidth = 0.6;
constexpr double kDoorHeight = 2.1;
const RoomBox kFirst{{-7.0, -3.5, 0.0}, {0.0, 3.5, kHeight}};
const RoomBox kSecond{{0.0, -3.5, 0.0}, {7.0, 3.5, kHeight}};

// The pieces of the wall with the door, as one of the rooms sees them: `normal_x` is +1 for the
// second room, -1 for the first.
Surface besideDoor(double normal_x, double side) {
  const double width = 3.5 - kDoorHalfWidth;
  return makeSurface({0.0, side * (kDoorHalfWidth + 0.5 * width), 0.5 * kHeight},
                     {normal_x, 0.0, 0.0}, Vector3d::UnitZ(), width, kHeight, Paint{});
}

Surface overDoor() {
  return makeSurface({0.0, 0.0, 0.5 * (kHeight + kDoorHeight)}, Vector3d::UnitX(),
                     Vector3d::UnitZ(), 2.0 * kDoorHalfWidth, kHeight - kDoorHeight, Paint{});
}

// 45 markers to a room: 12 on each whole wall, 4 and 5 beside the door.
void hangInRoom(const Build& build, const RoomBox& room, RoomFace far_wall, double normal_x,
                Random* random) {
  constexpr double kLow = -0.7;
  constexpr double kHigh = 0.7;
  for (const RoomFace wall : {kWallNorth, far_wall, kWallSouth}) {
    hangRow(build, roomFace(room, wall), 12, kLow, kHigh, random);
  }
  hangRow(build, besideDoor(normal_x, -1.0), 4, kLow, kHigh, random);
  hangRow(build, besideDoor(normal_x, 1.0), 5, kLow, kHigh, random);
}

// Half of the way: out of the door, round the second room looking at its walls, at the one with the
// door last, and back into the door. The other half is its mirror image in the first room. In the
// door the camera looks at the walls to the south of both rooms: the nearest markers that can be
// read in a small image.
ClosedSpline way() {
  struct Stop {
    double x, y, yaw_deg;
  };
  constexpr Stop kHalf[] = {{0.0, 0.0, -90.0},  {0.7, -0.1, -88.0}, {1.4, -0.5, -82.0},
                            {2.2, -1.0, -78.0}, {3.0, -1.4, -85.0}, {3.9, -1.5, -80.0},
                            {4.7, -1.3, -50.0}, {5.2, -0.7, -20.0}, {5.3, 0.1, 5.0},
                            {5.1, 0.9, 40.0},   {4.5, 1.4, 70.0},   {3.7, 1.6, 92.0},
                            {2.9, 1.5, 115.0},  {2.5, 1.0, 150.0},  {2.4, 0.2, 185.0},
                            {2.2, -0.6, 212.0}, {1.7, -0.8, 230.0}, {0.9, -0.25, 255.0}};
  std::vector<Vector4d> knots;
  for (const bool mirrored : {false, true}) {
    for (const Stop& stop : kHalf) {
      const double x = mirrored ? -stop.x : stop.x;
      const double degrees = mirrored ? 180.0 - stop.yaw_deg : stop.yaw_deg;
      knots.emplace_back(x, stop.y, degrees * std::numbers::pi / 180.0, 0.0);
    }
  }
  return ClosedSpline(knots, Vector4d::Zero());
}

}  // namespace

void buildLab(const Build& build) {
  addRoom(kFirst, build.scene);
  addRoom(kSecond, build.scene);
  // The rooms' own walls at x = 0 make way for the one with the door.
  std::erase_if(build.scene->surfaces, [](const Surface& surface) {
    return surface.T_w_s.p.x() == 0.0 && surface.T_w_s.R.col(2).x() != 0.0;
  });
  for (const double side : {-1.0, 1.0}) build.scene->surfaces.push_back(besideDoor(1.0, side));
  build.scene->surfaces.push_back(overDoor());

  Random random(build.seed, 0x4c4142);
  hangInRoom(build, kFirst, kWallWest, -1.0, &random);
  hangInRoom(build, kSecond, kWallEast, 1.0, &random);

  const double duration = build.scene->duration_s;
  // Both rooms twice in the usual 208 s: a quarter of a metre per second.
  const double rounds = std::max(1.0, std::round(duration / 104.0));
  const Sway sway(build.seed, duration,
                  {.position_m = 0.08, .yaw = 0.15, .pitch = 0.10, .roll = 0.08});
  build.scene->trajectory = [=, way = way()](double t) {
    constexpr double kStart = 0.25;  // in the second room, half-way round
    const Vector4d at = way.at(kStart + rounds * t / duration);
    constexpr double kEyeHeight = 1.5;  // metres
    return cameraPose(sway.apply({{at.x(), at.y(), kEyeHeight}, at.z(), 0.0, 0.0}, t));
  };
}

}  // namespace waymark::simulator
