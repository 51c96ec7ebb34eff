// The office, and what goes wrong in it: darkness, a passer-by, things that move, a blur, a stop, a
// turn on the spot. Markers are in view part of the time, never during what happens before the
// turn.
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "simulator/furniture.h"
#include "simulator/itinerary.h"
#include "simulator/office_room.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kHandsHeight = 1.45;  // metres

// Seconds on the way, which is walked in buildTrouble().
constexpr Interval kPasserBy{18.5, 21.5};
constexpr Interval kMovingThings{30.0, 35.0};
constexpr Interval kBlackout{35.4, 36.4};
constexpr Interval kBlur{49.0, 49.4};
constexpr Interval kStop{50.0, 55.0};
constexpr Interval kTurn{62.0, 72.0};

constexpr double kBlackoutLight = 0.02;
constexpr double kBlur_px = 8.0;

// The marker that follows whatever happens has been seen before.
Itinerary troubleWalk() {
  Itinerary walk({-0.6, 0.5, 90.0});
  walk.go({0.6, 0.5, 90.0}, 5).go({0.8, 0.0, 30.0}, 3);       // 8 s
  walk.go({0.7, -0.3, 5.0}, 3).go({0.9, -0.7, -15.0}, 4);     // the east wall
  walk.go({0.4, -0.5, -60.0}, 3).go({-0.1, -0.4, -90.0}, 3);  // the south wall, 21 s
  walk.go({-0.2, -0.3, -92.0}, 2).go({0.5, -0.5, -12.0}, 4);  // the east wall, 27 s
  walk.go({0.0, 0.2, -95.0}, 4).go({0.2, 0.4, -92.0}, 5);     // the south wall, 36 s
  walk.go({0.4, 0.3, -10.0}, 4).go({0.2, 0.5, 90.0}, 4);      // by the east wall to the north wall
  walk.go({-0.3, 0.5, 90.0}, 2).go({-0.3, 0.3, 160.0}, 3);    // the west wall, 49 s
  walk.rest(8).go({-0.3, 0.5, 90.0}, 3);                      // the north wall, 60 s
  walk.rest(2).goStill({-0.3, 0.5, -270.0}, 10).rest(2).go({-0.6, 0.5, -270.0}, 2);  // 76 s
  return walk;
}

// Seconds since the way was begun, the last time that it was.
double onWay(const WayTime& time, double time_s) {
  const double now = time.at(time_s);
  return now - kTroubleWay_s * std::floor(now / kTroubleWay_s);
}

// One part of a person: a rectangle that faces north, with the joint that it swings about in the
// middle of its top. In the person's frame: on the floor, x to the east.
struct BodyPart {
  double x_m, top_m, width_m, height_m, before_m;  // before_m: towards the viewer
  double swing_rad;
};

// A person in dark clothes who comes from the west, and is out of the room before and after.
void addPasserBy(const WayTime& time, Random* random, Scene* scene) {
  constexpr double kSpeed = 1.0;   // metres per second
  constexpr double kAlong = -1.7;  // the way is at this y
  constexpr double kOutside = 4.0;
  constexpr double kStrides_hz = 0.9;
  const double middle_s = 0.5 * (kPasserBy.begin_s + kPasserBy.end_s);
  const BodyPart parts[] = {{0.05, 0.90, 0.17, 0.90, 0.00, 0.45},
                            {0.0, 0.90, 0.17, 0.90, 0.02, -0.45},
                            {0.0, 1.48, 0.44, 0.64, 0.04, 0.0},
                            {0.05, 1.45, 0.12, 0.66, 0.08, -0.4},
                            {-0.02, 1.76, 0.18, 0.25, 0.04, 0.0}};
  for (const BodyPart& part : parts) {
    const Paint cloth{.mean = random->uniform(35.0, 75.0),
                      .contrast = 16.0,
                      .patches_per_m2 = 25.0,
                      .patch_size_m = 0.05,
                      .noise_wavelength_m = 0.12,
                      .texel_m = 0.004};
    Surface surface = makeSurface(Vector3d::Zero(), Vector3d::UnitY(), Vector3d::UnitZ(),
                                  part.width_m, part.height_m, cloth);
    const slam::Transform upright = surface.T_w_s;
    surface.motion = [=](double t) {
      const double since_s = onWay(time, t) - middle_s;
      const double x = std::clamp(kSpeed * since_s, -kOutside, kOutside);
      const double angle =
          part.swing_rad * std::sin(2.0 * std::numbers::pi * kStrides_hz * since_s);
      slam::Transform T_w_joint;
      T_w_joint.R = slam::expSo3({0.0, angle, 0.0});
      T_w_joint.p = {x + part.x_m, kAlong + part.before_m, part.top_m};
      slam::Transform T_joint_s = upright;
      T_joint_s.p = {0.0, 0.0, -0.5 * part.height_m};
      return T_w_joint * T_joint_s;
    };
    surface.T_w_s = surface.motion(0.0);
    scene->surfaces.push_back(surface);
  }
}

// Two displays before the south wall that somebody pushes 0.6 m along it and back.
void addDisplays(const Build& build, const WayTime& time) {
  constexpr double kSwing = 0.3;  // metres
  for (const double x : {-0.75, 0.45}) {
    const PosterImage picture = build.album->next();
    constexpr double kWidth = 0.42;
    constexpr double kDisplayHeight = 1.9;
    Surface display = makeSurface({x, -2.02, 0.08 + 0.5 * kDisplayHeight}, Vector3d::UnitY(),
                                  Vector3d::UnitZ(), kWidth, kDisplayHeight, Paint{});
    display.image = std::make_shared<PrintedImage>(picture.view());
    const slam::Transform rest = display.T_w_s;
    display.motion = [=](double t) {
      slam::Transform T_w_s = rest;
      const double now = onWay(time, t);
      if (kMovingThings.contains(now)) {
        const double part =
            (now - kMovingThings.begin_s) / (kMovingThings.end_s - kMovingThings.begin_s);
        T_w_s.p.x() += kSwing * (1.0 - std::cos(2.0 * std::numbers::pi * part));
      }
      return T_w_s;
    };
    build.scene->surfaces.push_back(display);
  }
}

}  // namespace

void buildTrouble(const Build& build) {
  Random random(build.seed, 0x54524f);
  const OfficeRoom room = addOfficeRoom(build, &random);
  hangMarkerAt(build, room.north, {-1.1, 2.5, 1.5}, &random);
  hangMarkerAt(build, room.north, {0.1, 2.5, 1.5}, &random);
  hangMarkerAt(build, room.east, {3.0, -0.44, 1.45}, &random);

  const Itinerary walk = troubleWalk();
  const WayTime time(build, walk.duration_s());
  addPasserBy(time, &random, build.scene);
  addDisplays(build, time);
  const double way_s = walk.duration_s();
  build.scene->disturbance = [=](double t) {
    const double now = onWay(time, t);
    return Disturbance{.light = kBlackout.contains(now) ? kBlackoutLight : 1.0,
                       .smear_px = kBlur.contains(now) ? kBlur_px : 0.0};
  };
  build.scene->largest_smear_px = kBlur_px;
  build.scene->events = {{"passer-by", kPasserBy}, {"moving things", kMovingThings},
                         {"blackout", kBlackout},  {"blur", kBlur},
                         {"stop", kStop},          {"turn", kTurn}};

  const Sway sway(build.seed, way_s,
                  {.position_m = 0.05, .yaw = 0.07, .pitch = 0.05, .roll = 0.04});
  build.scene->trajectory = [=, path = walk.path()](double t) {
    const double now = time.at(t);
    return cameraPose(swayed(path.at(now, kHandsHeight), sway, path.liveliness(now), now));
  };
}

}  // namespace waymark::simulator
