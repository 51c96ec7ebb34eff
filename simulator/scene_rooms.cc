// The scenes of one room, 6 x 5 x 2.7 m, its world frame in the middle of the floor, z up.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "simulator/scene_builders.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
const RoomBox kRoom{{-3.0, -2.5, 0.0}, {3.0, 2.5, 2.7}};
constexpr double kEyeHeight = 1.45;  // metres

// 13 or 11 markers to a wall, between knee and an arm's reach (the wall's y counts from its
// middle, 1.35 m up).
void hangOnWalls(const Build& build) {
  addRoom(kRoom, build.scene);
  Random random(build.seed, 0x57414c4c);
  const int counts[] = {13, 11, 13, 11};
  const RoomFace walls[] = {kWallNorth, kWallEast, kWallSouth, kWallWest};
  for (int i = 0; i < 4; ++i) {
    hangRow(build, roomFace(kRoom, walls[i]), counts[i], -0.65, 0.75, &random);
  }
}

// People walk round a room in about half a minute; longer takes are several rounds.
double roundsIn(double duration_s) { return std::max(1.0, std::round(duration_s / 30.0)); }

Vector3d onEllipse(double angle, double a, double b, double height) {
  return {a * std::cos(angle), b * std::sin(angle), height};
}

}  // namespace

void buildWalls(const Build& build) {
  hangOnWalls(build);
  const double duration = build.scene->duration_s;
  const double rounds = roundsIn(duration);
  const Sway sway(build.seed, duration,
                  {.position_m = 0.12, .yaw = 0.20, .pitch = 0.12, .roll = 0.10});
  build.scene->trajectory = [=](double t) {
    const double angle = kTwoPi * rounds * t / duration;
    const View view{onEllipse(angle, 1.1, 0.7, kEyeHeight), angle, 0.0, 0.0};
    return cameraPose(sway.apply(view, t));
  };
}

void buildCeiling(const Build& build) {
  addRoom(kRoom, build.scene);
  Random random(build.seed, 0x4345494c);
  const Surface ceiling = roomFace(kRoom, kCeiling);
  constexpr int kColumns = 8;
  constexpr int kRows = 6;
  const double width = 2.0 * ceiling.half_width_m / kColumns;
  const double height = 2.0 * ceiling.half_height_m / kRows;
  // On the diagonal a paper needs 1.5 of its side to stay in its own cell.
  const double play_x = std::max(0.0, 0.5 * (width - 1.5 * build.paperSide()));
  const double play_y = std::max(0.0, 0.5 * (height - 1.5 * build.paperSide()));
  for (int i = 0; i < kColumns * kRows; ++i) {
    const int column = i % kColumns;
    const int row = i / kColumns;
    const double x = (column + 0.5) * width - ceiling.half_width_m;
    const double y = (row + 0.5) * height - ceiling.half_height_m;
    hangMarker(build, ceiling, x + random.uniform(-play_x, play_x),
               y + random.uniform(-play_y, play_y), {.roll = std::numbers::pi, .tilt = 0.05},
               &random);
  }

  const double duration = build.scene->duration_s;
  const double rounds = roundsIn(duration);
  const Sway sway(build.seed, duration,
                  {.position_m = 0.12, .yaw = 0.20, .pitch = 0.14, .roll = 0.12});
  build.scene->trajectory = [=](double t) {
    const double angle = kTwoPi * rounds * t / duration;
    // Walking forwards along the ellipse, the camera held low and looking up ahead.
    const View view{onEllipse(angle, 1.6, 1.2, 0.95), angle + 0.5 * std::numbers::pi, 1.30, 0.0};
    return cameraPose(sway.apply(view, t));
  };
}

void buildRevisit(const Build& build) {
  hangOnWalls(build);
  const double duration = build.scene->duration_s;
  constexpr double kStepBack = 1.7;  // metres
  const Sway sway(build.seed, duration,
                  {.position_m = 0.05, .yaw = 0.15, .pitch = 0.10, .roll = 0.10});
  const OpenProgress progress(build);
  build.scene->trajectory = [=](double t) {
    const double s = progress.at(t);
    const double angle = kTwoPi * s;
    // Over the last third of the way the camera backs off from the wall it started at.
    const double last = std::clamp(3.0 * s - 2.0, 0.0, 1.0);
    const double back = kStepBack * last * last * (3.0 - 2.0 * last);
    View view{onEllipse(angle, 1.3, 0.8, kEyeHeight), angle, 0.0, 0.0};
    view.position.x() -= back;
    return cameraPose(sway.apply(view, t));
  };
}

void buildSpin(const Build& build) {
  hangOnWalls(build);
  const double duration = build.scene->duration_s;
  const double rounds = roundsIn(duration);
  const Sway sway(build.seed, duration,
                  {.position_m = 0.02, .yaw = 0.10, .pitch = 0.08, .roll = 0.06});
  build.scene->trajectory = [=](double t) {
    const double angle = kTwoPi * rounds * t / duration;
    // Held at arm's length less the hand's own turning: the camera's centre hardly moves.
    const View view{onEllipse(angle, 0.12, 0.12, kEyeHeight), angle, 0.0, 0.0};
    return cameraPose(sway.apply(view, t));
  };
}

}  // namespace waymark::simulator
