// Eleven objects on a table of 1.2 x 0.6 m, each with a target on it, and six natural markers A to
// F at 0.4, 0.4, 0.8, 0.8, 1.0 and 2.0 m from the table's middle (seed 2, section 4.2). The camera
// looks at each in turn, from as far away as that, and after each at the table. World frame: on the
// table in its middle, x along it to the right, y to the wall behind, z up.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "simulator/furniture.h"

namespace waymark::simulator {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

const RoomBox kTableRoom{{-2.2, -3.0, -0.74}, {2.6, 0.6, 1.86}};
constexpr int kElsewhere = 19;  // pictures that users know, but that are not here

struct Place {
  const char* name;
  Vector3d p_w;
  double width_m;     // of the picture; its shape is 3:4
  double distance_m;  // of the camera that looks at it
  bool standing;      // on the table, leaning back against a cardboard
  bool framed;        // in black
  bool cornered;      // with black squares in its corners
};

std::array<Place, 6> places() {
  return {{{"A", {-0.39, 0.06, 0.10}, 0.15, 0.45, true, true, false},
           {"B", {0.39, 0.06, 0.10}, 0.15, 0.45, true, false, false},
           {"C", {0.0, 0.6, 0.53}, 0.20, 0.8, false, false, false},
           {"D", {0.5, 0.6, 0.20}, 0.20, 0.8, false, false, true},
           {"E", {-0.72, 0.6, 0.36}, 0.21, 1.0, false, false, false},
           {"F", {1.87, 0.6, 0.38}, 0.30, 2.0, false, false, true}}};
}

// Black borders and squares make a picture easier to follow (seed 2, section 4.2.1).
PosterImage marked(const PosterImage& picture, const Place& place) {
  PosterImage result = picture;
  cv::Mat image(result.height, result.width, CV_8U, result.grey.data());
  const int side = result.width / 12;
  if (place.framed) {
    cv::rectangle(image, {0, 0, result.width, result.height}, cv::Scalar::all(0), side);
  }
  if (place.cornered) {
    for (const int x : {0, result.width - side}) {
      for (const int y : {0, result.height - side}) {
        image(cv::Rect(x, y, side, side)).setTo(0);
      }
    }
  }
  return result;
}

// What carries the marker of a place: the wall, or a cardboard that leans back by 15 degrees.
Surface support(const Place& place, const Surface& wall, Random* random, Scene* scene) {
  if (!place.standing) {
    Surface on_wall = wall;
    on_wall.T_w_s.p = place.p_w;
    return on_wall;
  }
  const double lean = std::numbers::pi / 12.0;
  const Vector3d normal(0.0, -std::cos(lean), std::sin(lean));
  const Vector3d up(0.0, std::sin(lean), std::cos(lean));
  const double width = 1.2 * place.width_m;
  const Surface card = covered(makeSurface(place.p_w, normal, up, width, 1.3333 * width, Paint{}),
                               materialImage(width, 1.3333 * width, 125.0, 10.0, random));
  scene->surfaces.push_back(card);
  return card;
}

void addNaturalMarkers(const Build& build, const Surface& wall, Random* random) {
  for (const Place& place : places()) {
    const Surface carrier = support(place, wall, random, build.scene);
    const PosterImage picture = marked(build.album->next(), place);
    const Print print = makePrint(picture, place.width_m, carrier, {0.0, 0.0}, 0.0);
    build.scene->prints.push_back(print);
    build.scene->natural.push_back(
        {place.name, picture, print.width_m, print.height_m, print.T_w_p});
  }
  for (int i = 1; i <= kElsewhere; ++i) {
    PosterImage picture = build.album->next();
    const double width_m = 0.20;
    const double height_m = width_m * picture.height / picture.width;
    build.scene->natural.push_back(
        {"elsewhere " + std::to_string(i), std::move(picture), width_m, height_m, std::nullopt});
  }
}

void addFiducials(const Build& build, const Surface& wall, Random* random) {
  for (const Place& place : places()) {
    const Surface carrier = support(place, wall, random, build.scene);
    hangMarker(build, carrier, 0.0, 0.0, {.roll = 0.0, .tilt = 0.0}, random);
  }
}

// A white dot on black, leaning back, on the front of an object's top. Its middle is the target.
void addTarget(const Vector3d& p_w, Scene* scene) {
  constexpr int kSide = 64;
  PosterImage dot{kSide, kSide, std::vector<std::uint8_t>(std::size_t{kSide} * kSide, 0)};
  cv::Mat image(kSide, kSide, CV_8U, dot.grey.data());
  cv::circle(image, {8 * kSide - 8, 8 * kSide - 8}, 16 * 26, cv::Scalar::all(255), cv::FILLED,
             cv::LINE_AA, 4);
  const double c = std::sqrt(0.5);
  const Surface label = makeSurface(p_w, {0.0, -c, c}, {0.0, c, c}, 0.03, 0.03, Paint{});
  scene->prints.push_back(makePrint(dot, 0.03, label, {0.0, 0.0}, 0.0, 0.0));
  scene->targets.push_back({std::to_string(scene->targets.size() + 1), p_w});
}

// A can of twelve sides. Its lid: three squares make a twelve-sided star.
void addCan(double x_m, double y_m, double radius_m, double height_m, Random* random,
            Scene* scene) {
  constexpr int kSides = 12;
  const PosterImage label = makePoster(PosterStyle::kShapes, random->next(), 480, 200);
  const int strip = label.width / kSides;
  const double apothem = radius_m * std::cos(std::numbers::pi / kSides);
  const double width = 2.0 * radius_m * std::sin(std::numbers::pi / kSides);
  for (int i = 0; i < kSides; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / kSides;
    const Vector3d normal(std::cos(angle), std::sin(angle), 0.0);
    const ImageView part{label.grey.data() + static_cast<std::ptrdiff_t>(i) * strip, strip,
                         label.height, label.width};
    const Vector3d middle = Vector3d(x_m, y_m, 0.5 * height_m) + apothem * normal;
    scene->surfaces.push_back(
        covered(makeSurface(middle, normal, Vector3d::UnitZ(), width, height_m, Paint{}),
                std::make_shared<PrintedImage>(part)));
  }
  const SharedImage metal = materialImage(2.0 * radius_m, 2.0 * radius_m, 175.0, 10.0, random);
  for (int i = 0; i < 3; ++i) {
    const double angle = std::numbers::pi * (i / 6.0 + 1.0 / kSides);
    const Vector3d up(std::cos(angle), std::sin(angle), 0.0);
    const double side = std::sqrt(2.0) * radius_m;
    scene->surfaces.push_back(covered(
        makeSurface({x_m, y_m, height_m - 2e-5 * i}, Vector3d::UnitZ(), up, side, side, Paint{}),
        metal));
  }
}

void addObjects(Random* random, Scene* scene) {
  struct Object {
    double x_m, y_m, width_m, depth_m, height_m;
    bool can;
  };
  constexpr Object kObjects[] = {
      {-0.50, -0.17, 0.14, 0.19, 0.03, false}, {-0.28, 0.20, 0.12, 0.07, 0.19, false},
      {-0.24, -0.13, 0.08, 0.08, 0.10, true},  {-0.09, 0.10, 0.10, 0.07, 0.13, false},
      {0.00, -0.19, 0.16, 0.11, 0.04, false},  {0.10, 0.21, 0.13, 0.06, 0.20, false},
      {0.14, 0.02, 0.07, 0.07, 0.12, true},    {0.27, -0.18, 0.11, 0.09, 0.07, false},
      {0.28, 0.21, 0.10, 0.08, 0.15, false},   {0.51, -0.16, 0.12, 0.17, 0.05, false},
      {-0.53, 0.22, 0.09, 0.09, 0.17, false}};
  const BoxImage package = [random](BoxFace, double width_m, double height_m) {
    const int width = 320;
    const int height = std::clamp(static_cast<int>(320.0 * height_m / width_m), 60, 600);
    const auto style = random->next() % 2 == 0 ? PosterStyle::kText : PosterStyle::kShapes;
    const PosterImage print = makePoster(style, random->next(), width, height);
    return std::make_shared<PrintedImage>(print.view());
  };
  for (const Object& object : kObjects) {
    if (object.can) {
      addCan(object.x_m, object.y_m, 0.5 * object.width_m, object.height_m, random, scene);
    } else {
      addBox(boxAt(object.x_m, object.y_m, 0.0, random->uniform(-0.35, 0.35), object.width_m,
                   object.depth_m, object.height_m),
             package, scene);
    }
    addTarget({object.x_m, object.y_m, object.height_m + 0.014}, scene);
  }
}

void addTableRoom(const Build& build, Random* random, Surface* wall) {
  *wall = wallSurface(kTableRoom, kWallNorth, {}, random);
  build.scene->surfaces.push_back(*wall);
  for (const RoomFace face : {kWallEast, kWallSouth, kWallWest}) {
    build.scene->surfaces.push_back(wallSurface(kTableRoom, face, {.doors_m = {1.8}}, random));
  }
  const Vector3d size = kTableRoom.high - kTableRoom.low;
  build.scene->surfaces.push_back(
      covered(roomFace(kTableRoom, kFloor), floorImage(size.x(), size.y(), random)));
  build.scene->surfaces.push_back(
      covered(roomFace(kTableRoom, kCeiling), ceilingImage(size.x(), size.y(), random)));
  const Paint wood{.mean = 150.0,
                   .contrast = 10.0,
                   .patches_per_m2 = 0.0,
                   .noise_wavelength_m = 0.06,
                   .texel_m = 0.001};
  build.scene->surfaces.push_back(
      makeSurface(Vector3d::Zero(), Vector3d::UnitZ(), Vector3d::UnitY(), 1.2, 0.6, wood));
  const BoxImage plain = [random](BoxFace, double width_m, double height_m) {
    return materialImage(width_m, height_m, 120.0, 10.0, random);
  };
  addBox(boxAt(0.0, 0.0, -0.045, 0.0, 1.2, 0.6, 0.044), plain, build.scene);
  for (const double x : {-0.57, 0.57}) {
    for (const double y : {-0.27, 0.27}) {
      addBox(boxAt(x, y, -0.74, 0.0, 0.05, 0.05, 0.70), plain, build.scene);
    }
  }
  hangNotice(build, *wall, onSurface(*wall, {1.1, 0.6, 0.6}), random);
  hangNotice(build, *wall, onSurface(*wall, {-1.4, 0.6, 0.7}), random);
}

// Where the camera is, and at what it looks, a knot a second.
struct Knots {
  std::vector<Vector4d> eye;
  std::vector<Vector4d> target;

  void add(const Vector3d& eye_w, const Vector3d& target_w) {
    eye.emplace_back(eye_w.x(), eye_w.y(), eye_w.z(), 0.0);
    target.emplace_back(target_w.x(), target_w.y(), target_w.z(), 0.0);
  }
};

Knots tableWalk(std::vector<Event>* events) {
  const Vector3d table(0.0, 0.02, 0.05);
  const auto before_table = [](double part) {
    return Vector3d(0.5 * part - 0.25, -0.85 + 0.1 * part, 0.55 + 0.08 * part);
  };
  Knots knots;
  for (const Place& place : places()) {
    const auto begin_s = static_cast<double>(knots.eye.size());
    const Vector3d view = place.p_w + Vector3d(0.05, -place.distance_m, 0.05);
    knots.add(0.5 * (before_table(1.0) + view), 0.5 * (table + place.p_w));
    for (const double x : {-0.04, 0.02, 0.04, 0.0}) {
      knots.add(view + Vector3d(x, 0.0, 0.5 * x), place.p_w);
    }
    knots.add(0.5 * (before_table(0.0) + view), 0.5 * (table + place.p_w));
    for (const double part : {0.0, 0.25, 0.5, 0.75, 1.0}) knots.add(before_table(part), table);
    events->push_back({std::string("marker ") + place.name, {begin_s + 1.0, begin_s + 4.0}});
    events->push_back({std::string("table ") + place.name, {begin_s + 6.0, begin_s + 10.0}});
  }
  return knots;
}

void buildTableScene(const Build& build, bool fiducials) {
  Random random(build.seed, 0x544142);
  Surface wall;
  addTableRoom(build, &random, &wall);
  if (fiducials) {
    addFiducials(build, wall, &random);
  } else {
    addNaturalMarkers(build, wall, &random);
  }
  Random of_objects(build.seed, 0x4f424a);  // the same with pictures and with fiducials
  addObjects(&of_objects, build.scene);

  const Knots knots = tableWalk(&build.scene->events);
  const WayTime time(build, kTableWay_s);
  const ClosedSpline eye(knots.eye, Vector4d::Zero());
  const ClosedSpline target(knots.target, Vector4d::Zero());
  const Sway sway(build.seed, kTableWay_s,
                  {.position_m = 0.02, .yaw = 0.03, .pitch = 0.03, .roll = 0.05});
  build.scene->trajectory = [=](double t) {
    const double now = time.at(t);
    const double part = now / kTableWay_s;
    const View view = viewTowards(eye.at(part).head<3>(), target.at(part).head<3>());
    return cameraPose(sway.apply(view, now));
  };
}

}  // namespace

void buildTable(const Build& build) { buildTableScene(build, false); }

void buildTableFiducials(const Build& build) { buildTableScene(build, true); }

}  // namespace waymark::simulator
