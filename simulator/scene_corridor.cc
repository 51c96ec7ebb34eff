// A corridor of 25 m with a right-angle corner: doors, notices, few markers; a walker goes to its
// end and back. World frame: on the floor where the walk begins, x along the first leg, y along the
// second, z up.
#include <cmath>
#include <numbers>

#include "simulator/furniture.h"
#include "simulator/itinerary.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kCeilingHeight = 2.6;  // metres
constexpr double kWalkersEye = 1.5;

struct CorridorWalls {
  Surface right, left, outer, inner, start, end;
};

// The wall between two points of the floor, seen with the first of them on the left.
Surface wallFrom(const Vector2d& left, const Vector2d& right, WallLook look, Random* random) {
  const Vector2d along = right - left;
  look.width_m = along.norm();
  look.height_m = kCeilingHeight;
  look.dado = true;
  const Vector3d x(along.x() / look.width_m, along.y() / look.width_m, 0.0);
  const Vector2d middle = 0.5 * (left + right);
  const Surface wall =
      makeSurface({middle.x(), middle.y(), 0.5 * kCeilingHeight}, x.cross(Vector3d::UnitZ()),
                  Vector3d::UnitZ(), look.width_m, kCeilingHeight, Paint{});
  return covered(wall, wallImage(look, random));
}

CorridorWalls addWalls(Scene* scene, Random* random) {
  const CorridorWalls walls{
      wallFrom({14.0, -1.0}, {-2.0, -1.0}, {.doors_m = {2.1, 7.2, 11.4, 14.4}}, random),
      wallFrom({-2.0, 1.0}, {12.0, 1.0}, {.doors_m = {1.0, 5.4, 9.9}}, random),
      wallFrom({14.0, 14.0}, {14.0, -1.0}, {.doors_m = {2.2, 6.1, 10.7}}, random),
      wallFrom({12.0, 1.0}, {12.0, 14.0}, {.doors_m = {2.6, 8.3, 11.6}}, random),
      wallFrom({-2.0, -1.0}, {-2.0, 1.0}, {.doors_m = {0.6}}, random),
      wallFrom({12.0, 14.0}, {14.0, 14.0}, {}, random)};
  for (const Surface* wall :
       {&walls.right, &walls.left, &walls.outer, &walls.inner, &walls.start, &walls.end}) {
    scene->surfaces.push_back(*wall);
  }
  for (const RoomBox& leg : {RoomBox{{-2.0, -1.0, 0.0}, {12.0, 1.0, kCeilingHeight}},
                             RoomBox{{12.0, -1.0, 0.0}, {14.0, 14.0, kCeilingHeight}}}) {
    const Vector3d size = leg.high - leg.low;
    scene->surfaces.push_back(
        covered(roomFace(leg, kFloor), floorImage(size.x(), size.y(), random)));
    scene->surfaces.push_back(
        covered(roomFace(leg, kCeiling), ceilingImage(size.x(), size.y(), random)));
  }
  return walls;
}

void furnish(const Build& build, const CorridorWalls& walls, Random* random) {
  const auto picture = [&](const Surface& wall, const Vector3d& p_w, double width_m) {
    hangPicture(build, wall, onSurface(wall, p_w), width_m, random);
  };
  const auto notice = [&](const Surface& wall, const Vector3d& p_w) {
    hangNotice(build, wall, onSurface(wall, p_w), random);
  };
  picture(walls.left, {2.2, 1.0, 1.55}, 0.5);
  notice(walls.left, {4.7, 1.0, 1.6});
  picture(walls.left, {6.0, 1.0, 1.55}, 0.6);
  notice(walls.left, {9.2, 1.0, 1.5});
  picture(walls.left, {10.6, 1.0, 1.5}, 0.42);
  notice(walls.right, {1.3, -1.0, 1.55});
  picture(walls.right, {3.7, -1.0, 1.5}, 0.6);
  notice(walls.right, {5.7, -1.0, 1.6});
  picture(walls.right, {8.3, -1.0, 1.55}, 0.5);
  notice(walls.right, {12.9, -1.0, 1.5});
  addNoticeBoard(build, walls.outer, onSurface(walls.outer, {14.0, 0.1, 1.5}), 1.5, 1.0, 9, random);
  picture(walls.outer, {14.0, 2.2, 1.55}, 0.5);
  notice(walls.outer, {14.0, 5.0, 1.6});
  picture(walls.outer, {14.0, 9.3, 1.5}, 0.6);
  notice(walls.outer, {14.0, 12.9, 1.5});
  picture(walls.inner, {12.0, 2.3, 1.55}, 0.5);
  notice(walls.inner, {12.0, 5.0, 1.5});
  picture(walls.inner, {12.0, 6.6, 1.5}, 0.42);
  notice(walls.inner, {12.0, 8.1, 1.55});
  picture(walls.inner, {12.0, 10.6, 1.55}, 0.6);
  picture(walls.start, {-2.0, 0.65, 1.55}, 0.42);
  picture(walls.end, {12.5, 14.0, 1.5}, 0.5);

  // Cupboards and a crate or two along the walls.
  const BoxImage wood = [random](BoxFace face, double width_m, double height_m) {
    return face == BoxFace::kFront ? shelfImage(width_m, height_m, random)
                                   : materialImage(width_m, height_m, 125.0, 14.0, random);
  };
  const BoxImage cardboard = [random](BoxFace, double width_m, double height_m) {
    return materialImage(width_m, height_m, 140.0, 18.0, random);
  };
  constexpr double kQuarterTurn = 0.5 * std::numbers::pi;
  addBox(boxAt(5.3, 0.83, 0.0, 0.0, 0.9, 0.32, 1.1), wood, build.scene);
  addBox(boxAt(13.83, 5.0, 0.0, -kQuarterTurn, 0.9, 0.32, 1.1), wood, build.scene);
  addBox(boxAt(0.2, -0.82, 0.0, 0.1, 0.4, 0.3, 0.35), cardboard, build.scene);
  addBox(boxAt(12.25, 7.5, 0.0, 0.3, 0.35, 0.3, 0.4), cardboard, build.scene);
}

// Steps bounce the head, and rock it from side to side at half their rate.
View onFoot(View view, double steps_hz, double share, double phase, double time_s) {
  const double step = 2.0 * std::numbers::pi * steps_hz * time_s + phase;
  const double side = 0.015 * share * std::sin(0.5 * step);
  view.position += Vector3d(-std::sin(view.yaw), std::cos(view.yaw), 0.0) * side;
  view.position.z() += 0.02 * share * std::sin(step);
  view.yaw += 0.006 * share * std::sin(0.5 * step + 2.0);
  view.pitch += 0.004 * share * std::sin(step + 1.0);
  view.roll += 0.006 * share * std::sin(0.5 * step + 0.5);
  return view;
}

// At 1 m/s, 67 beats. A look at the first marker, to the end, round there, and back.
Itinerary corridorWalk() {
  Itinerary walk({0.0, 0.0, 38.0});
  walk.rest(3).go({0.0, 0.0, 10.0}, 1).go({1.0, 0.0, 0.0}, 1).go({11.0, 0.0, 0.0}, 10);
  walk.go({12.0, 0.0, 20.0}, 1).go({13.0, 0.0, 52.0}, 1).go({13.0, 1.0, 78.0}, 1);
  walk.go({13.0, 2.0, 90.0}, 1).go({13.0, 12.0, 90.0}, 10).rest(1);
  walk.goStill({13.0, 12.0, 270.0}, 5).rest(1);
  walk.go({13.0, 2.0, 270.0}, 10).go({13.0, 1.0, 250.0}, 1).go({13.0, 0.0, 218.0}, 1);
  walk.go({12.0, 0.0, 192.0}, 1).go({11.0, 0.0, 180.0}, 1).go({0.0, 0.0, 180.0}, 11);
  walk.rest(1).goStill({0.0, 0.0, 38.0}, 4).rest(1);
  return walk;
}

}  // namespace

void buildCorridor(const Build& build) {
  Random random(build.seed, 0x434f52);
  const CorridorWalls walls = addWalls(build.scene, &random);
  // 9 m from one to the next along the way.
  const Crookedness hung{.roll = 0.04, .tilt = 0.0};
  const auto hang = [&](const Surface& wall, const Vector3d& p_w) {
    const Vector2d at = onSurface(wall, p_w);
    hangMarker(build, wall, at.x(), at.y(), hung, &random);
  };
  hang(walls.left, {1.25, 1.0, 1.5});
  hang(walls.right, {10.4, -1.0, 1.5});
  hang(walls.outer, {14.0, 6.0, 1.55});
  hang(walls.end, {13.1, 14.0, 1.5});
  furnish(build, walls, &random);

  const Itinerary walk = corridorWalk();
  const double way_s = walk.duration_s();
  const WayTime time(build, way_s);
  const Sway sway(build.seed, way_s,
                  {.position_m = 0.05, .yaw = 0.06, .pitch = 0.03, .roll = 0.02});
  // 1.8 Hz, in whole strides over the way.
  const double steps_hz = 2.0 * std::round(0.9 * way_s) / way_s;
  const double phase = random.uniform(0.0, 2.0 * std::numbers::pi);
  build.scene->trajectory = [=, path = walk.path()](double t) {
    const double now = time.at(t);
    const double share = path.liveliness(now);
    const View view = swayed(path.at(now, kWalkersEye), sway, 0.3 + 0.7 * share, now);
    return cameraPose(onFoot(view, steps_hz, share, phase, now));
  };
}

}  // namespace waymark::simulator
