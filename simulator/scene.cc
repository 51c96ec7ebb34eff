#include "simulator/scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "simulator/scene_builders.h"

namespace waymark::simulator {
namespace {

constexpr ImageSize kVga{640, 480};
constexpr ImageSize k960p{1280, 960};
constexpr ImageSize k1080p{1920, 1080};
constexpr ImageSize kQvga{320, 240};

const std::vector<SceneKind>& kinds() {
  static const std::vector<SceneKind> all = {
      {{"walls", "a room of 6 x 5 m, 48 markers on the walls, once round"},
       kVga,
       60.0,
       30.0,
       0.123,
       48,
       false,
       buildWalls},
      {{"ceiling", "the same room, 48 markers on the ceiling, once round looking up"},
       kVga,
       60.0,
       30.0,
       0.123,
       48,
       false,
       buildCeiling},
      {{"revisit", "once round the walls, back to the first view from 1.7 m farther away"},
       kVga,
       60.0,
       30.0,
       0.123,
       48,
       false,
       buildRevisit},
      {{"spin", "nearly pure rotation in the middle of the room"},
       k960p,
       30.0,
       30.0,
       0.123,
       48,
       false,
       buildSpin},
      {{"lab", "two rooms of 7 x 7 m joined by a door, 90 markers"},
       k1080p,
       60.0,
       208.0,
       0.123,
       90,
       false,
       buildLab},
      {{"sheet", "a printed A4 sheet of 24 markers, along its border"},
       k1080p,
       30.0,
       30.0,
       0.032,
       24,
       false,
       buildSheet},
      {{"box", "a box with markers on five sides, once round it"},
       k960p,
       30.0,
       30.0,
       0.06,
       20,
       false,
       buildBox},
      {{"dolly", "along a wall with two markers 3.5 m apart, wide lens panned by 45 degrees"},
       kQvga,
       30.0,
       20.0,
       0.20,
       2,
       true,
       buildDolly},
      {{"corridor",
        "25 m of corridor with a corner, there and back; a marker every 9 m, wide lens"},
       kVga,
       30.0,
       kCorridorWay_s,
       0.20,
       4,
       true,
       buildCorridor,
       12},
      {{"office", "an office with markers on one wall; once round, away from them for 14 s"},
       kVga,
       30.0,
       kOfficeWay_s,
       0.15,
       3,
       false,
       buildOffice,
       10},
      {{"trouble", "the office, with darkness, a passer-by, moving walls, a blur, a stop, a turn"},
       kVga,
       30.0,
       kTroubleWay_s,
       0.15,
       3,
       false,
       buildTrouble,
       10},
      {{"building",
        "a corridor with six rooms, 60 markers; through all of them, and back past their doors"},
       kVga,
       15.0,
       kBuildingWay_s,
       0.20,
       60,
       false,
       buildBuilding},
      {{"table",
        "eleven objects on a table, pictures as natural markers 0.4 to 2 m from its middle"},
       kVga,
       30.0,
       kTableWay_s,
       0.12,
       0,
       false,
       buildTable,
       25},
      {{"table_fiducials", "the same with markers in place of the pictures"},
       kVga,
       30.0,
       kTableWay_s,
       0.12,
       6,
       false,
       buildTableFiducials},
      {{"board", "a board for calibration (waymark print board's), from all sides"},
       kVga,
       5.0,
       60.0,
       0.018,
       0,
       false,
       buildBoard},
      {{"chessboard", "the same without markers: a plain chessboard of 7 x 10 squares of 25 mm"},
       kVga,
       5.0,
       60.0,
       0.018,
       0,
       false,
       buildChessboard},
  };
  return all;
}

const SceneKind* findKind(const std::string& name) {
  for (const SceneKind& kind : kinds()) {
    if (kind.info.name == name) return &kind;
  }
  return nullptr;
}

// The lens of a small camera: 64 degrees across and a moderate barrel distortion, or a wide one of
// 79 degrees. Its middle is a few pixels off the image's, as ever.
slam::Calibration lens(const ImageSize& size, bool wide) {
  slam::Calibration c;
  c.width = size.width;
  c.height = size.height;
  c.fx = (wide ? 0.61 : 0.80) * size.width;
  c.fy = 1.002 * c.fx;
  c.cx = 0.5 * (size.width - 1) + 0.006 * size.width;
  c.cy = 0.5 * (size.height - 1) - 0.008 * size.height;
  if (wide) {
    c.distortion = {-0.10, 0.012, 0.0003, -0.0002};
  } else {
    c.distortion = {-0.20, 0.05, 0.0005, -0.0007};
  }
  return c;
}

// Angles are as far from the middle as they are wide, but for a little.
slam::Calibration fisheye(slam::Calibration c, double degrees) {
  c.model = slam::DistortionModel::kEquidistant;
  c.fx = c.fy = c.width * 180.0 / (degrees * std::numbers::pi);
  c.distortion = {-0.01, 0.002, 0.0, 0.0};
  return c;
}

std::string joinedSceneNames() {
  std::string names;
  for (const SceneKind& kind : kinds()) names += (names.empty() ? "" : ", ") + kind.info.name;
  return names;
}

Marker* findMarker(Scene* scene, int id) {
  for (Marker& marker : scene->markers) {
    if (marker.id == id) return &marker;
  }
  return nullptr;
}

Status checkMarkers(const Options& options, Scene* scene) {
  const std::string there_are =
      scene->markers.empty()
          ? "the scene has none"
          : "the scene's ids are 0 to " + std::to_string(scene->markers.size() - 1);
  if (options.moved_marker && findMarker(scene, options.moved_marker->id) == nullptr) {
    return Error{"no marker " + std::to_string(options.moved_marker->id) +
                 " to move: " + there_are};
  }
  if (options.doubled_id && findMarker(scene, *options.doubled_id) == nullptr) {
    return Error{"no marker " + std::to_string(*options.doubled_id) +
                 " to print twice: " + there_are};
  }
  return success();
}

// The marker farthest from the doubled one gets its id.
void doubleMarker(int id, Scene* scene) {
  const auto first = std::find_if(scene->markers.begin(), scene->markers.end(),
                                  [id](const Marker& marker) { return marker.id == id; });
  const Eigen::Vector3d position = first->T_w_m.p;
  std::max_element(scene->markers.begin(), scene->markers.end(),
                   [&](const Marker& a, const Marker& b) {
                     return (a.T_w_m.p - position).norm() < (b.T_w_m.p - position).norm();
                   })
      ->id = id;
  // Whoever looks an id up finds the original first.
  std::iter_swap(scene->markers.begin(), first);
}

}  // namespace

const std::vector<SceneInfo>& sceneList() {
  static const std::vector<SceneInfo> list = [] {
    std::vector<SceneInfo> infos;
    for (const SceneKind& kind : kinds()) infos.push_back(kind.info);
    return infos;
  }();
  return list;
}

Result<Scene> buildScene(const Options& options, Ending ending) {
  const SceneKind* kind = findKind(options.scene);
  if (kind == nullptr) {
    return Error{"unknown scene '" + options.scene + "'; there are " + joinedSceneNames()};
  }
  if (std::string reason = options.invalidReason(); !reason.empty()) return Error{reason};
  std::optional<slam::Dictionary> dictionary = slam::Dictionary::byName(options.dictionary);
  if (!dictionary) return Error{"unknown dictionary '" + options.dictionary + "'"};
  if (dictionary->size() < kind->marker_count) {
    return Error{"scene " + options.scene + " needs " + std::to_string(kind->marker_count) +
                 " markers, but " + options.dictionary + " has only " +
                 std::to_string(dictionary->size())};
  }

  Scene scene{.name = options.scene,
              .dictionary = std::move(*dictionary),
              .camera = lens(options.size.value_or(kind->size), kind->wide_lens),
              .rate_hz = options.rate_hz.value_or(kind->rate_hz),
              .duration_s = options.duration_s.value_or(kind->duration_s),
              .surfaces = {},
              .markers = {},
              .prints = {},
              .trajectory = {}};
  if (options.fisheye_deg) scene.camera = fisheye(scene.camera, *options.fisheye_deg);
  Result<Album> album = Album::open(options.pictures, options.seed, kind->pictures);
  if (!album) return album.error();
  kind->build({.scene = &scene,
               .seed = options.seed,
               .marker_size_m = options.marker_size_m.value_or(kind->marker_size_m),
               .closed_loop = ending == Ending::kClosedLoop,
               .album = &*album});
  if (Status status = checkMarkers(options, &scene); !status) return status.error();
  if (options.doubled_id) doubleMarker(*options.doubled_id, &scene);
  return scene;
}

Surface makeSurface(const Eigen::Vector3d& centre, const Eigen::Vector3d& normal,
                    const Eigen::Vector3d& up, double width_m, double height_m,
                    const Paint& paint) {
  Surface surface;
  surface.T_w_s.R << up.cross(normal), up, normal;
  surface.T_w_s.p = centre;
  surface.half_width_m = 0.5 * width_m;
  surface.half_height_m = 0.5 * height_m;
  surface.paint = paint;
  return surface;
}

Surface roomFace(const RoomBox& room, RoomFace face) {
  using Eigen::Vector3d;
  const Vector3d middle = 0.5 * (room.low + room.high);
  const Vector3d size = room.high - room.low;
  const Vector3d x = Vector3d::UnitX();
  const Vector3d y = Vector3d::UnitY();
  const Vector3d z = Vector3d::UnitZ();
  const Paint wall;
  const Paint above{.mean = 172.0, .contrast = 14.0, .patches_per_m2 = 0.5, .patch_size_m = 0.2};
  const Paint below{.mean = 105.0, .contrast = 26.0, .patches_per_m2 = 1.0, .patch_size_m = 0.15};
  switch (face) {
    case kWallNorth:
      return makeSurface({middle.x(), room.high.y(), middle.z()}, -y, z, size.x(), size.z(), wall);
    case kWallEast:
      return makeSurface({room.high.x(), middle.y(), middle.z()}, -x, z, size.y(), size.z(), wall);
    case kWallSouth:
      return makeSurface({middle.x(), room.low.y(), middle.z()}, y, z, size.x(), size.z(), wall);
    case kWallWest:
      return makeSurface({room.low.x(), middle.y(), middle.z()}, x, z, size.y(), size.z(), wall);
    case kCeiling:
      return makeSurface({middle.x(), middle.y(), room.high.z()}, -z, y, size.x(), size.y(), above);
    case kFloor:
      break;
  }
  return makeSurface({middle.x(), middle.y(), room.low.z()}, z, y, size.x(), size.y(), below);
}

void addRoom(const RoomBox& room, Scene* scene) {
  for (const RoomFace face : {kWallNorth, kWallEast, kWallSouth, kWallWest, kCeiling, kFloor}) {
    scene->surfaces.push_back(roomFace(room, face));
  }
}

void hangMarker(const Build& build, const Surface& surface, double x_m, double y_m,
                const Crookedness& crookedness, Random* random) {
  const double roll = random->uniform(-crookedness.roll, crookedness.roll);
  const double tilt_x = random->uniform(-crookedness.tilt, crookedness.tilt);
  const double tilt_y = random->uniform(-crookedness.tilt, crookedness.tilt);
  constexpr double kPaperGap = 0.002;  // metres between paper and wall
  const double lift = kPaperGap + 0.5 * build.paperSide() *
                                      (std::sin(std::abs(tilt_x)) + std::sin(std::abs(tilt_y))) *
                                      1.2;
  slam::Transform T_s_m;
  T_s_m.R = slam::expSo3({tilt_x, tilt_y, 0.0}) * slam::expSo3({0.0, 0.0, roll});
  T_s_m.p = {x_m, y_m, lift};
  build.scene->markers.push_back({.id = static_cast<int>(build.scene->markers.size()),
                                  .size_m = build.marker_size_m,
                                  .T_w_m = surface.T_w_s * T_s_m});
}

void hangRow(const Build& build, const Surface& surface, int count, double low_m, double high_m,
             Random* random) {
  const double slot = 2.0 * surface.half_width_m / count;
  const double play = std::max(0.0, 0.5 * (slot - 1.2 * build.paperSide()));
  // Steps of the golden ratio scatter the heights evenly, whatever the count.
  double height = random->uniform(0.0, 1.0);
  for (int i = 0; i < count; ++i) {
    height = std::fmod(height + 0.618, 1.0);
    const double x = (i + 0.5) * slot - surface.half_width_m + random->uniform(-play, play);
    hangMarker(build, surface, x, low_m + (high_m - low_m) * height, Crookedness{}, random);
  }
}

OpenProgress::OpenProgress(const Build& build)
    : duration_s_(build.scene->duration_s), there_and_back_(build.closed_loop) {}

WayTime::WayTime(const Build& build, double way_s)
    : way_s_(way_s), duration_s_(build.scene->duration_s), closed_loop_(build.closed_loop) {}

double WayTime::at(double time_s) const {
  if (!closed_loop_) return time_s;
  // A duration in frames is not the way's to the last bit.
  const double ways = std::floor(duration_s_ / way_s_ + 1e-6);
  if (ways >= 1.0) return time_s * ways * way_s_ / duration_s_;
  const double radians_per_s = 2.0 * std::numbers::pi / duration_s_;
  return (1.0 - std::cos(radians_per_s * time_s)) / radians_per_s;
}

double OpenProgress::at(double time_s) const {
  const double s = time_s / duration_s_;
  return there_and_back_ ? 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * s) : s;
}

}  // namespace waymark::simulator
