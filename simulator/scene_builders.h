// What the scenes' builders share. One file per family of scenes: scene_rooms.cc, scene_lab.cc,
// scene_objects.cc, scene_dolly.cc, scene_corridor.cc, scene_office.cc, scene_trouble.cc,
// scene_table.cc, scene_board.cc, scene_building.cc. What corridor, office, trouble and table
// furnish their rooms with: furniture.h.
#pragma once

#include <cstdint>
#include <string>

#include <Eigen/Core>

#include "simulator/album.h"
#include "simulator/random.h"
#include "simulator/scene.h"

namespace waymark::simulator {

// What a builder is told, and the scene it fills: surfaces, markers and the trajectory.
struct Build {
  Scene* scene;
  std::uint64_t seed;
  double marker_size_m;
  bool closed_loop;  // the trajectory must repeat after scene->duration_s
  Album* album;      // what hangs on walls

  // Side of the paper: the black square and a white cell all round.
  [[nodiscard]] double paperSide() const {
    return marker_size_m * (scene->dictionary.cells() + 2) / scene->dictionary.cells();
  }
};

// A scene before options change it.
struct SceneKind {
  SceneInfo info;
  ImageSize size;
  double rate_hz;
  double duration_s;
  double marker_size_m;
  int marker_count;
  bool wide_lens;
  void (*build)(const Build&);
  int pictures = 0;  // that it takes from the album
};

// After so long these are where they began: their usual durations.
inline constexpr double kCorridorWay_s = 67.0;
inline constexpr double kOfficeWay_s = 36.0;
inline constexpr double kTroubleWay_s = 76.0;
inline constexpr double kTableWay_s = 66.0;
inline constexpr double kBuildingWay_s = 286.0;

void buildWalls(const Build& build);
void buildCeiling(const Build& build);
void buildRevisit(const Build& build);
void buildSpin(const Build& build);
void buildLab(const Build& build);
void buildSheet(const Build& build);
void buildBox(const Build& build);
void buildDolly(const Build& build);
void buildCorridor(const Build& build);
void buildOffice(const Build& build);
void buildTrouble(const Build& build);
void buildTable(const Build& build);
void buildTableFiducials(const Build& build);
void buildBuilding(const Build& build);
void buildBoard(const Build& build);
void buildChessboard(const Build& build);

// A rectangle that faces `normal`, with `up` (perpendicular to it) as its y axis.
[[nodiscard]] Surface makeSurface(const Eigen::Vector3d& centre, const Eigen::Vector3d& normal,
                                  const Eigen::Vector3d& up, double width_m, double height_m,
                                  const Paint& paint);

// The six faces of a box seen from inside, in the order: walls at y max, x max, y min, x min, then
// ceiling and floor.
struct RoomBox {
  Eigen::Vector3d low;
  Eigen::Vector3d high;
};
enum RoomFace { kWallNorth, kWallEast, kWallSouth, kWallWest, kCeiling, kFloor };
[[nodiscard]] Surface roomFace(const RoomBox& room, RoomFace face);
void addRoom(const RoomBox& room, Scene* scene);

// How crookedly people hang markers, radians.
struct Crookedness {
  double roll = 0.15;
  double tilt = 0.10;
};

// Hangs a marker at (x, y) of the surface, lifted off it just enough for its tilt. Ids count up.
void hangMarker(const Build& build, const Surface& surface, double x_m, double y_m,
                const Crookedness& crookedness, Random* random);

// Hangs `count` markers side by side along the surface's x axis, at scattered heights
// low_m .. high_m of its y axis.
void hangRow(const Build& build, const Surface& surface, int count, double low_m, double high_m,
             Random* random);

// Time as progress 0 .. 1 over the scene; in a closed loop there and back, for paths that end
// elsewhere than they began.
class OpenProgress {
 public:
  explicit OpenProgress(const Build& build);
  [[nodiscard]] double at(double time_s) const;

 private:
  double duration_s_;
  bool there_and_back_;
};

// The time on a way that is at its beginning again after `way_s`, and is gone at its own speed
// whatever the scene's duration: a shorter scene ends before, a longer one begins again. A closed
// loop goes round in a whole number of ways, slower by less than a half; one that is too short for
// that goes there and back over the first part.
class WayTime {
 public:
  WayTime(const Build& build, double way_s);
  [[nodiscard]] double at(double time_s) const;

 private:
  double way_s_;
  double duration_s_;
  bool closed_loop_;
};

}  // namespace waymark::simulator
