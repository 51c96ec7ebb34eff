#include "simulator/furniture.h"

#include <algorithm>
#include <utility>

namespace waymark::simulator {

using Eigen::Vector2d;
using Eigen::Vector3d;

Surface covered(Surface surface, SharedImage image) {
  surface.image = std::move(image);
  return surface;
}

Surface wallSurface(const RoomBox& room, RoomFace face, WallLook look, Random* random) {
  const Surface wall = roomFace(room, face);
  look.width_m = 2.0 * wall.half_width_m;
  look.height_m = 2.0 * wall.half_height_m;
  return covered(wall, wallImage(look, random));
}

Vector2d onSurface(const Surface& surface, const Vector3d& p_w) {
  return (surface.T_w_s.inverse() * p_w).head<2>();
}

Print makePrint(const PosterImage& picture, double width_m, const Surface& surface,
                const Vector2d& at_m, double roll_rad, double lift_m) {
  slam::Transform T_s_p;
  T_s_p.R = slam::expSo3({0.0, 0.0, roll_rad});
  T_s_p.p = {at_m.x(), at_m.y(), lift_m};
  return {std::make_shared<PrintedImage>(picture.view()), width_m,
          width_m * picture.height / picture.width, surface.T_w_s * T_s_p};
}

void hangPicture(const Build& build, const Surface& surface, const Vector2d& at_m, double width_m,
                 Random* random) {
  build.scene->prints.push_back(
      makePrint(build.album->next(), width_m, surface, at_m, random->uniform(-0.02, 0.02)));
}

void hangNotice(const Build& build, const Surface& surface, const Vector2d& at_m, Random* random) {
  constexpr double kWidth = 0.21;  // metres
  const PosterImage notice = makePoster(PosterStyle::kText, random->next(), 300, 424);
  build.scene->prints.push_back(
      makePrint(notice, kWidth, surface, at_m, random->uniform(-0.05, 0.05)));
}

void addNoticeBoard(const Build& build, const Surface& wall, const Vector2d& at_m, double width_m,
                    double height_m, int notices, Random* random) {
  constexpr double kThick = 0.012;  // metres
  Surface board = wall;
  board.T_w_s.p = wall.T_w_s * Vector3d(at_m.x(), at_m.y(), kThick);
  board.half_width_m = 0.5 * width_m;
  board.half_height_m = 0.5 * height_m;
  board.image = materialImage(width_m, height_m, 120.0, 22.0, random);
  build.scene->surfaces.push_back(board);
  // Side by side in one row or two, as many as there are.
  const int rows = height_m > 0.75 ? 2 : 1;
  const int columns = (notices + rows - 1) / rows;
  for (int i = 0; i < notices; ++i) {
    const double x = (i % columns + 0.5) * width_m / columns - 0.5 * width_m;
    const double y = (i / columns + 0.5) * height_m / rows - 0.5 * height_m;
    const double play = std::max(0.0, 0.5 * width_m / columns - 0.12);
    hangNotice(build, board,
               {x + random->uniform(-play, play),
                y + random->uniform(-0.2, 0.2) * (height_m / rows - 0.3)},
               random);
  }
}

Box boxAt(double x_m, double y_m, double z_m, double yaw_rad, double width_m, double depth_m,
          double height_m) {
  Box box;
  box.T_w_b.R = slam::expSo3({0.0, 0.0, yaw_rad});
  box.T_w_b.p = {x_m, y_m, z_m};
  box.size_m = {width_m, depth_m, height_m};
  return box;
}

void addBox(const Box& box, const BoxImage& image, Scene* scene) {
  const Vector3d half = 0.5 * box.size_m;
  const Vector3d middle(0.0, 0.0, half.z());
  const Vector3d z = Vector3d::UnitZ();
  struct Side {
    BoxFace face;
    Vector3d normal;
    Vector3d up;
    double width_m;
    double height_m;
  };
  const Vector3d& size = box.size_m;
  const Side sides[] = {{BoxFace::kFront, -Vector3d::UnitY(), z, size.x(), size.z()},
                        {BoxFace::kRight, Vector3d::UnitX(), z, size.y(), size.z()},
                        {BoxFace::kBack, Vector3d::UnitY(), z, size.x(), size.z()},
                        {BoxFace::kLeft, -Vector3d::UnitX(), z, size.y(), size.z()},
                        {BoxFace::kTop, z, Vector3d::UnitY(), size.x(), size.y()}};
  for (const Side& side : sides) {
    Surface surface = makeSurface(middle + half.cwiseProduct(side.normal), side.normal, side.up,
                                  side.width_m, side.height_m, Paint{});
    surface.T_w_s = box.T_w_b * surface.T_w_s;
    scene->surfaces.push_back(covered(surface, image(side.face, side.width_m, side.height_m)));
  }
}

}  // namespace waymark::simulator
