// An office with markers on its north wall only: the camera looks at them, walks once round the
// room with its back to them, and comes back.
#include "simulator/itinerary.h"
#include "simulator/office_room.h"

namespace waymark::simulator {
namespace {

constexpr double kOfficeEye = 1.45;  // metres

Itinerary officeWalk() {
  Itinerary walk({-0.8, 0.5, 92.0});
  walk.go({0.8, 0.5, 88.0}, 5).go({1.3, -0.2, 20.0}, 3).go({1.2, -1.2, -35.0}, 3);
  walk.go({0.2, -1.4, -80.0}, 3).go({-0.9, -1.3, -120.0}, 3).go({-1.5, -0.5, -170.0}, 3);
  walk.go({-1.5, 0.5, -215.0}, 3).go({-1.0, 0.9, -260.0}, 2).go({0.5, 0.7, -272.0}, 5);
  walk.go({-0.8, 0.5, -268.0}, 6);
  return walk;
}

}  // namespace

void buildOffice(const Build& build) {
  Random random(build.seed, 0x4f4646);
  const OfficeRoom room = addOfficeRoom(build, &random);
  for (const double x : {-1.1, 0.1, 1.2}) {
    hangMarkerAt(build, room.north, {x, 2.5, 1.5}, &random);
  }
  const Itinerary walk = officeWalk();
  const WayTime time(build, walk.duration_s());
  const Sway sway(build.seed, walk.duration_s(),
                  {.position_m = 0.06, .yaw = 0.08, .pitch = 0.06, .roll = 0.05});
  build.scene->trajectory = [=, path = walk.path()](double t) {
    const double now = time.at(t);
    return cameraPose(sway.apply(path.at(now, kOfficeEye), now));
  };
}

}  // namespace waymark::simulator
