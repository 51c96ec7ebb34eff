#include "simulator/office_room.h"

#include <numbers>

#include "simulator/furniture.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;

const RoomBox kOffice{{-3.0, -2.5, 0.0}, {3.0, 2.5, 2.7}};
constexpr double kQuarterTurn = 0.5 * std::numbers::pi;

void addDesk(double x_m, double y_m, double yaw_rad, Random* random, Scene* scene) {
  const slam::Transform T_w_d = boxAt(x_m, y_m, 0.0, yaw_rad, 1.0, 1.0, 1.0).T_w_b;
  const auto place = [&](double x, double y, double z, double turn, double width, double depth,
                         double height) {
    Box box = boxAt(x, y, z, turn, width, depth, height);
    box.T_w_b = T_w_d * box.T_w_b;
    return box;
  };
  const BoxImage wood = [random](BoxFace, double width_m, double height_m) {
    return materialImage(width_m, height_m, 140.0, 18.0, random);
  };
  const BoxImage dark = [random](BoxFace, double width_m, double height_m) {
    return materialImage(width_m, height_m, 50.0, 8.0, random);
  };
  // What is on the screen, and on the papers beside it.
  const BoxImage screen = [random](BoxFace face, double width_m, double height_m) -> SharedImage {
    if (face != BoxFace::kFront) return materialImage(width_m, height_m, 40.0, 5.0, random);
    const PosterImage text = makePoster(PosterStyle::kText, random->next(), 480, 300);
    return std::make_shared<PrintedImage>(text.view(), 30.0, 235.0);
  };
  const BoxImage papers = [random](BoxFace face, double width_m, double height_m) -> SharedImage {
    if (face != BoxFace::kTop) return materialImage(width_m, height_m, 170.0, 8.0, random);
    const PosterImage text = makePoster(PosterStyle::kText, random->next(), 300, 424);
    return std::make_shared<PrintedImage>(text.view());
  };
  addBox(place(0.0, 0.0, 0.70, 0.0, 1.6, 0.75, 0.03), wood, scene);
  addBox(place(-0.74, 0.0, 0.0, 0.0, 0.04, 0.7, 0.70), wood, scene);
  addBox(place(0.55, 0.02, 0.0, 0.0, 0.42, 0.65, 0.62), wood, scene);  // drawers
  addBox(place(-0.1, 0.15, 0.80, random->uniform(-0.3, 0.3), 0.55, 0.04, 0.34), screen, scene);
  addBox(place(-0.1, 0.18, 0.73, 0.0, 0.18, 0.16, 0.07), dark, scene);
  addBox(place(0.5, -0.05, 0.73, random->uniform(-0.4, 0.4), 0.21, 0.297, 0.05), papers, scene);
  addBox(place(-0.55, -0.1, 0.73, random->uniform(-0.4, 0.4), 0.21, 0.297, 0.01), papers, scene);
}

void addShelf(double x_m, double y_m, double yaw_rad, double width_m, double height_m,
              Random* random, Scene* scene) {
  const BoxImage image = [random](BoxFace face, double width, double height) {
    return face == BoxFace::kFront ? shelfImage(width, height, random)
                                   : materialImage(width, height, 150.0, 12.0, random);
  };
  addBox(boxAt(x_m, y_m, 0.0, yaw_rad, width_m, 0.34, height_m), image, scene);
}

}  // namespace

OfficeRoom addOfficeRoom(const Build& build, Random* random) {
  Scene* const scene = build.scene;
  // Doors and windows count from the left end, as one looks at the wall.
  const OfficeRoom room{
      wallSurface(kOffice, kWallNorth, {.doors_m = {5.2}}, random),
      wallSurface(kOffice, kWallEast, {.windows_m = {0.95, 3.9}}, random),
      wallSurface(kOffice, kWallSouth, {.doors_m = {4.4}}, random),
      wallSurface(kOffice, kWallWest, {}, random),
  };
  for (const Surface* wall : {&room.north, &room.east, &room.south, &room.west}) {
    scene->surfaces.push_back(*wall);
  }
  const Vector3d size = kOffice.high - kOffice.low;
  scene->surfaces.push_back(
      covered(roomFace(kOffice, kFloor), floorImage(size.x(), size.y(), random)));
  scene->surfaces.push_back(
      covered(roomFace(kOffice, kCeiling), ceilingImage(size.x(), size.y(), random)));

  const auto picture = [&](const Surface& wall, const Vector3d& p_w, double width_m) {
    hangPicture(build, wall, onSurface(wall, p_w), width_m, random);
  };
  const auto notice = [&](const Surface& wall, const Vector3d& p_w) {
    hangNotice(build, wall, onSurface(wall, p_w), random);
  };
  picture(room.north, {-2.1, 2.5, 1.6}, 0.6);
  picture(room.north, {-0.5, 2.5, 1.65}, 0.5);
  notice(room.north, {0.6, 2.5, 1.7});
  picture(room.east, {3.0, 0.0, 1.75}, 0.4);
  notice(room.east, {3.0, 0.45, 1.5});
  picture(room.south, {-0.5, -2.5, 1.6}, 0.6);
  notice(room.south, {0.05, -2.5, 1.4});
  notice(room.south, {-2.35, -2.5, 1.5});
  addNoticeBoard(build, room.west, onSurface(room.west, {-3.0, 0.9, 1.55}), 1.4, 0.9, 7, random);
  picture(room.west, {-3.0, -0.35, 1.6}, 0.6);
  picture(room.west, {-3.0, -1.6, 1.6}, 0.5);

  addDesk(2.55, -0.8, -kQuarterTurn, random, scene);
  addDesk(2.55, 1.2, -kQuarterTurn, random, scene);
  addDesk(-2.55, 0.6, kQuarterTurn, random, scene);
  addShelf(0.9, -2.32, 2.0 * kQuarterTurn, 1.0, 2.0, random, scene);
  addShelf(2.0, -2.32, 2.0 * kQuarterTurn, 0.9, 1.3, random, scene);
  addShelf(-2.82, -1.5, kQuarterTurn, 1.2, 1.0, random, scene);
  addShelf(-2.1, 2.32, 0.0, 1.0, 0.8, random, scene);
  return room;
}

void hangMarkerAt(const Build& build, const Surface& wall, const Vector3d& p_w, Random* random) {
  const Eigen::Vector2d at = onSurface(wall, p_w);
  hangMarker(build, wall, at.x() + random->uniform(-0.05, 0.05),
             at.y() + random->uniform(-0.05, 0.05), {.roll = 0.06, .tilt = 0.02}, random);
}

}  // namespace waymark::simulator
