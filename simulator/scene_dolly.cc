// A straight walk into a building (seed 2, section 4.1): a wall of 4 m with randomly fixed papers
// and two markers 3.5 m apart; a camera on a dolly, panned by 45 degrees, moves parallel to it.
// World frame: on the floor below the first marker, x along the way, y into the wall, z up.
#include <numbers>

#include "simulator/scene_builders.h"

namespace waymark::simulator {

void buildDolly(const Build& build) {
  constexpr double kBetweenMarkers = 3.5;  // metres
  constexpr double kWallLength = 4.0;
  constexpr double kMarkerHeight = 1.4;
  constexpr double kDistance = 0.9;  // of the dolly from the wall
  const RoomBox hall{{-4.0, -3.5, 0.0}, {6.5, 0.05, 2.6}};
  addRoom(hall, build.scene);
  const Paint papers{.mean = 165.0,
                     .contrast = 12.0,
                     .patches_per_m2 = 9.0,
                     .patch_size_m = 0.18,
                     .noise_wavelength_m = 0.4,
                     .texel_m = 0.003};
  const Surface wall = makeSurface({0.5 * kBetweenMarkers, 0.0, 1.3}, {0.0, -1.0, 0.0},
                                   Eigen::Vector3d::UnitZ(), kWallLength, 2.6, papers);
  build.scene->surfaces.push_back(wall);

  Random random(build.seed, 0x444f);
  for (const double x : {-0.5 * kBetweenMarkers, 0.5 * kBetweenMarkers}) {
    hangMarker(build, wall, x, kMarkerHeight - 1.3, {.roll = 0.0, .tilt = 0.0}, &random);
  }

  const double duration = build.scene->duration_s;
  // A dolly rolls: what shakes is the pushing hand and the floor.
  const Sway sway(build.seed, duration,
                  {.position_m = 0.008, .yaw = 0.012, .pitch = 0.008, .roll = 0.008});
  const OpenProgress progress(build);
  build.scene->trajectory = [=](double t) {
    // From half a metre before the place where the first marker is in the middle of the image, to
    // the same place of the second.
    const double x = -kDistance - 0.5 + (kBetweenMarkers + 0.5) * progress.at(t);
    const View view{{x, -kDistance, kMarkerHeight - 0.1}, 0.25 * std::numbers::pi, 0.0, 0.0};
    return cameraPose(sway.apply(view, t));
  };
}

}  // namespace waymark::simulator
