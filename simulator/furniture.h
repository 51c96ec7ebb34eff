// What rooms are furnished with: surfaces covered by images, pictures on walls, boxes.
#pragma once

#include <functional>
#include <memory>

#include <Eigen/Core>

#include "simulator/interior.h"
#include "simulator/scene_builders.h"

namespace waymark::simulator {

// The surface with this image from edge to edge.
[[nodiscard]] Surface covered(Surface surface, SharedImage image);

// A wall of the room with the image of `look` (its width and height are the wall's), and where a
// point of the world is on a surface, metres in its frame.
[[nodiscard]] Surface wallSurface(const RoomBox& room, RoomFace face, WallLook look,
                                  Random* random);
[[nodiscard]] Eigen::Vector2d onSurface(const Surface& surface, const Eigen::Vector3d& p_w);

// A picture as a print of its own shape, at (x, y) of the surface, `lift_m` before it.
[[nodiscard]] Print makePrint(const PosterImage& picture, double width_m, const Surface& surface,
                              const Eigen::Vector2d& at_m, double roll_rad, double lift_m = 0.002);

// The album's next picture, hung there a little crookedly.
void hangPicture(const Build& build, const Surface& surface, const Eigen::Vector2d& at_m,
                 double width_m, Random* random);

// A sheet of print, A4 upright, that nobody chose for its looks.
void hangNotice(const Build& build, const Surface& surface, const Eigen::Vector2d& at_m,
                Random* random);

// A board of cork of that size with `notices` on it.
void addNoticeBoard(const Build& build, const Surface& wall, const Eigen::Vector2d& at_m,
                    double width_m, double height_m, int notices, Random* random);

// A box on the floor, or on something. T_w_b: origin in the middle of its bottom, z up, its front
// towards -y.
struct Box {
  slam::Transform T_w_b;
  Eigen::Vector3d size_m = Eigen::Vector3d::Zero();  // width, depth, height
};
enum class BoxFace { kFront, kRight, kBack, kLeft, kTop };
using BoxImage = std::function<SharedImage(BoxFace face, double width_m, double height_m)>;
void addBox(const Box& box, const BoxImage& image, Scene* scene);
[[nodiscard]] Box boxAt(double x_m, double y_m, double z_m, double yaw_rad, double width_m,
                        double depth_m, double height_m);

}  // namespace waymark::simulator
