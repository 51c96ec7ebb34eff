// A corridor of 24 m with three rooms on each side, 60 markers: 8 in each room, and 12 on boards
// that stand out over the corridor, one on each face. World frame: on the floor at the corridor's
// end, x along it, y to the left, z up.
//
// On the way out the walker enters room by room, on the left and across the corridor on the right.
// Only the first one shows a marker together with the corridor's; what is on the boards' other
// faces is seen on the way back, and with it, through the doors, a marker in each room that he has
// been in.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "simulator/itinerary.h"
#include "simulator/scene_builders.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kStoreyHeight = 2.6;  // metres, as all here
constexpr double kCorridorLength = 24.0;
constexpr double kHalfCorridor = 1.0;
constexpr double kRoomDepth = 5.0;
constexpr double kRoomWidth = 8.0;
constexpr double kHalfDoor = 0.55;
constexpr double kLintel = 2.1;
constexpr double kEyes = 1.5;
constexpr std::array<double, 3> kDoors = {4.0, 12.0, 20.0};  // of the rooms on either side

// side: 1 on the left, -1 on the right.
RoomBox roomAt(double door_x, double side) {
  const double near = side * kHalfCorridor;
  const double far = side * (kHalfCorridor + kRoomDepth);
  return {{door_x - 0.5 * kRoomWidth, std::min(near, far), 0.0},
          {door_x + 0.5 * kRoomWidth, std::max(near, far), kStoreyHeight}};
}

// All faces but those that have doors.
void addBoxes(Scene* scene) {
  addRoom({{0.0, -kHalfCorridor, 0.0}, {kCorridorLength, kHalfCorridor, kStoreyHeight}}, scene);
  for (const double x : kDoors) {
    for (const double side : {1.0, -1.0}) addRoom(roomAt(x, side), scene);
  }
  std::erase_if(scene->surfaces, [](const Surface& surface) {
    return std::abs(std::abs(surface.T_w_s.p.y()) - kHalfCorridor) < 1e-9 &&
           std::abs(surface.T_w_s.R.col(2).y()) > 0.5;
  });
}

void addDoorWalls(Scene* scene) {
  for (const double side : {1.0, -1.0}) {
    const auto piece = [&](double from_x, double to_x, double low, double high) {
      scene->surfaces.push_back(
          makeSurface({0.5 * (from_x + to_x), side * kHalfCorridor, 0.5 * (low + high)},
                      {0.0, -side, 0.0}, Vector3d::UnitZ(), to_x - from_x, high - low, Paint{}));
    };
    double from_x = 0.0;
    for (const double x : kDoors) {
      piece(from_x, x - kHalfDoor, 0.0, kStoreyHeight);
      piece(x - kHalfDoor, x + kHalfDoor, kLintel, kStoreyHeight);
      from_x = x + kHalfDoor;
    }
    piece(from_x, kCorridorLength, 0.0, kStoreyHeight);
  }
}

// Four on the wall opposite the door, near enough to its middle to be seen from the corridor with
// nothing of it; two on each wall beside. Of those on the wall that the way back comes towards, one
// is seen from the corridor through the door.
void hangInRoomAt(const Build& build, double door_x, double side, Random* random) {
  const RoomBox room = roomAt(door_x, side);
  const auto hang = [&](RoomFace face, double along_m, double height_m) {
    const Surface wall = roomFace(room, face);
    hangMarker(build, wall, along_m, height_m + random->uniform(-0.15, 0.15) - 0.5 * kStoreyHeight,
               {.roll = 0.1, .tilt = 0.03}, random);
  };
  const double middle_y = 0.5 * (room.low.y() + room.high.y());
  // A wall's x axis runs to the right as one looks at it.
  const auto onWest = [&](double y) { return y - middle_y; };
  const auto onEast = [&](double y) { return middle_y - y; };
  for (const double x : {-2.0, -0.7, 0.6, 1.9}) {
    hang(side > 0.0 ? kWallNorth : kWallSouth, x, 1.5);
  }
  hang(kWallWest, onWest(side * 3.0), 1.55);
  hang(kWallWest, onWest(side * 4.8), 1.4);
  hang(kWallEast, onEast(side * 4.6), 1.45);
  hang(kWallEast, onEast(side * 5.5), 1.6);
}

// A board over the corridor, with a marker on either face.
void hangBoard(const Build& build, double x, double y, Random* random) {
  const double side_m = 1.1 * build.paperSide();
  constexpr double kBoardHeight = 2.05;
  for (const double towards : {-1.0, 1.0}) {
    const Surface face =
        makeSurface({x + 0.01 * towards, y, kBoardHeight}, {towards, 0.0, 0.0}, Vector3d::UnitZ(),
                    side_m, side_m, {.mean = 190.0, .contrast = 6.0, .patches_per_m2 = 0.0});
    build.scene->surfaces.push_back(face);
    hangMarker(build, face, 0.0, 0.0, {.roll = 0.02, .tilt = 0.0}, random);
  }
}

// In at the door, a look to the left and to the right, and straight out into what is opposite.
void visit(double x, double side, int beats, Itinerary* walk) {
  const double in = side > 0.0 ? 90.0 : -90.0;
  const double stand_y = side * 2.9;
  walk->go({x, stand_y, in}, beats).rest(1);
  walk->go({x, stand_y, in + side * 100.0}, 4).rest(1);
  walk->go({x, stand_y, in - side * 100.0}, 8).rest(1);
  walk->go({x, stand_y, in - side * 180.0}, 4);
}

// 0.7 m/s at most.
Itinerary buildingWalk() {
  Itinerary walk({1.0, 0.0, 0.0});
  walk.rest(2);
  for (const double x : kDoors) {
    walk.go({x, 0.0, 0.0}, x < 5.0 ? 5 : 12).go({x, 0.0, 90.0}, 4);
    visit(x, 1.0, 5, &walk);   // looks to -90 at its end
    visit(x, -1.0, 9, &walk);  // to 90
    walk.go({x, 0.0, 90.0}, 5).go({x, 0.0, 0.0}, 4);
  }
  walk.go({23.0, 0.0, 0.0}, 5).go({23.0, 0.0, 180.0}, 7).rest(1);
  for (const double x : {21.8, 13.8, 5.8}) walk.go({x, 0.0, 180.0}, x > 20.0 ? 2 : 12).rest(2);
  walk.go({1.0, 0.0, 180.0}, 7).go({1.0, 0.0, 360.0}, 7).rest(1);
  return walk;
}

}  // namespace

void buildBuilding(const Build& build) {
  addBoxes(build.scene);
  addDoorWalls(build.scene);
  Random random(build.seed, 0x424c44);
  for (const double x : kDoors) {
    for (const double side : {1.0, -1.0}) hangInRoomAt(build, x, side, &random);
  }
  constexpr double kBoards[][2] = {{2.6, 0.0},  {6.6, 0.7},  {10.2, 0.0},
                                   {14.8, 0.0}, {18.2, 0.0}, {21.3, 0.0}};
  for (const auto& [x, y] : kBoards) hangBoard(build, x, y, &random);

  const Itinerary walk = buildingWalk();
  const double way_s = walk.duration_s();
  const WayTime time(build, way_s);
  const Sway sway(build.seed, way_s,
                  {.position_m = 0.04, .yaw = 0.03, .pitch = 0.03, .roll = 0.03});
  build.scene->trajectory = [=, path = walk.path()](double t) {
    const double now = time.at(t);
    const double share = 0.3 + 0.7 * path.liveliness(now);
    return cameraPose(swayed(path.at(now, kEyes), sway, share, now));
  };
}

}  // namespace waymark::simulator
