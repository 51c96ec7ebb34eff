// The scenes in which markers are seen now and then: what happens in them, and when; and what only
// they need of renderer and sensor.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "simulator/projected_marker.h"
#include "simulator/simulation.h"
#include "simulator/testing/bare_scene.h"

namespace waymark::simulator {
namespace {

std::unique_ptr<const Simulation> open(const std::string& name, std::uint64_t seed = 1,
                                       Ending ending = Ending::kOfTheScene) {
  Options options;
  options.scene = name;
  options.seed = seed;
  options.noise_sigma = 0.0;
  auto simulation = Simulation::create(options, ending);
  if (!simulation) {
    ADD_FAILURE() << simulation.error().message;
    return nullptr;
  }
  return std::move(*simulation);
}

std::int64_t frameAt(const Simulation& simulation, double time_s) {
  return std::llround(time_s * simulation.scene().rate_hz);
}

Interval eventOf(const Simulation& simulation, const std::string& what) {
  for (const Event& event : simulation.scene().events) {
    if (event.what == what) return event.when;
  }
  ADD_FAILURE() << "no event " << what;
  return {};
}

class Image {
 public:
  Image(const Simulation& simulation, std::int64_t frame)
      : width_(simulation.camera().width), height_(simulation.camera().height) {
    pixels_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    Simulation::Workspace workspace;
    simulation.render(frame, &workspace, pixels_.data());
  }
  [[nodiscard]] double at(int x, int y) const {
    return pixels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                   static_cast<std::size_t>(x)];
  }
  [[nodiscard]] double mean() const {
    double sum = 0.0;
    for (const std::uint8_t pixel : pixels_) sum += pixel;
    return sum / static_cast<double>(pixels_.size());
  }
  // Mean square of the difference of neighbours `dx`, `dy` apart.
  [[nodiscard]] double steepness(int dx, int dy) const {
    double sum = 0.0;
    for (int y = 0; y + dy < height_; ++y) {
      for (int x = 0; x + dx < width_; ++x) {
        const double difference = at(x + dx, y + dy) - at(x, y);
        sum += difference * difference;
      }
    }
    return sum / static_cast<double>(pixels_.size());
  }

 private:
  int width_;
  int height_;
  std::vector<std::uint8_t> pixels_;
};

// Those that a detector can read: 16 pixels and more on their shortest side.
std::size_t readable(const Simulation& simulation, std::int64_t frame) {
  constexpr double kShortest_px = 16.0;
  const slam::CameraModel camera(simulation.camera());
  const slam::Transform T_w_c = simulation.poseAt(frame);
  const std::vector<Marker> visible = simulation.visibleMarkers(frame);
  return static_cast<std::size_t>(std::ranges::count_if(visible, [&](const Marker& marker) {
    return shortestSide(*projectMarker(camera, T_w_c, marker)) >= kShortest_px;
  }));
}

// The stretches of frames without a readable marker: begin and end, frames.
std::vector<std::pair<std::int64_t, std::int64_t>> gapsOf(const Simulation& simulation) {
  std::vector<std::pair<std::int64_t, std::int64_t>> gaps;
  std::optional<std::int64_t> since;
  for (std::int64_t k = 0; k <= simulation.frameCount(); ++k) {
    const bool gap = k < simulation.frameCount() && readable(simulation, k) == 0;
    if (gap && !since) since = k;
    if (!gap && since) {
      gaps.emplace_back(*since, k);
      since.reset();
    }
  }
  return gaps;
}

double lengthOf(const Simulation& simulation, std::int64_t begin, std::int64_t end) {
  double length = 0.0;
  for (std::int64_t k = begin + 1; k < end; ++k) {
    length += (simulation.poseAt(k).p - simulation.poseAt(k - 1).p).norm();
  }
  return length;
}

// The surface that a ray of the camera meets first; -1 for none.
int firstSurface(const Scene& scene, double time_s, const Eigen::Vector3d& ray_c) {
  const slam::Transform T_w_c = scene.trajectory(time_s);
  double nearest = 1e9;
  int first = -1;
  for (std::size_t i = 0; i < scene.surfaces.size(); ++i) {
    const Surface& surface = scene.surfaces[i];
    const slam::Transform T_s_c = surface.placeAt(time_s).inverse() * T_w_c;
    const Eigen::Vector3d d = T_s_c.R * ray_c;
    const double s = -T_s_c.p.z() / d.z();
    if (!(s > 0.0 && s < nearest)) continue;
    const Eigen::Vector3d hit = T_s_c.p + s * d;
    if (std::abs(hit.x()) > surface.half_width_m || std::abs(hit.y()) > surface.half_height_m) {
      continue;
    }
    nearest = s;
    first = static_cast<int>(i);
  }
  return first;
}

// Part of the image that shows surfaces that are on the move at this time.
double movingPart(const Simulation& simulation, double time_s) {
  const Scene& scene = simulation.scene();
  const slam::CameraModel camera(simulation.camera());
  int moving = 0;
  int all = 0;
  for (int y = 4; y < simulation.camera().height; y += 12) {
    for (int x = 4; x < simulation.camera().width; x += 12) {
      const auto ray = camera.undistort(Eigen::Vector2d(x, y));
      if (!ray) continue;
      const int first = firstSurface(scene, time_s, ray->homogeneous());
      ++all;
      if (first < 0) continue;
      const Surface& surface = scene.surfaces[static_cast<std::size_t>(first)];
      moving += (surface.placeAt(time_s + 0.01).p - surface.placeAt(time_s - 0.01).p).norm() > 1e-4;
    }
  }
  return static_cast<double>(moving) / all;
}

TEST(WayScenes, AreAtTheirBeginningAgainAtTheirEnd) {
  for (const char* name :
       {"corridor", "office", "trouble", "table", "table_fiducials", "building"}) {
    const auto simulation = open(name);
    const Trajectory& pose = simulation->scene().trajectory;
    const double way_s = simulation->scene().duration_s;
    EXPECT_LT((pose(0.0).p - pose(way_s).p).norm(), 1e-9) << name;
    EXPECT_LT(slam::rotationDistance(pose(0.0).R, pose(way_s).R), 1e-6) << name;
    EXPECT_GT((pose(0.0).p - pose(0.5 * way_s).p).norm(), 0.1) << name;
  }
}

// However short, a loop is no faster than the way itself.
TEST(WayScenes, LoopsKeepTheWaysSpeed) {
  for (const double loop_s : {8.0, 80.0}) {
    Options options;
    options.scene = "corridor";
    options.size = ImageSize{64, 48};
    options.duration_s = loop_s;
    const auto simulation = Simulation::create(options, Ending::kClosedLoop);
    ASSERT_TRUE(simulation.ok());
    const Trajectory& pose = (*simulation)->scene().trajectory;
    double fastest = 0.0;
    for (double t = 0.0; t < loop_s; t += 0.02) {
      fastest = std::max(fastest, (pose(t + 0.01).p - pose(t).p).norm() / 0.01);
    }
    EXPECT_LT(fastest, 1.35) << loop_s;
    EXPECT_LT((pose(0.0).p - pose(loop_s).p).norm(), 1e-9) << loop_s;
  }
}

// Of the rooms' doors one shows markers of both sides on the way out, the others on the way back
// only; and then all do.
TEST(Building, IsConnectedOnTheWayBack) {
  const auto simulation = open("building");
  EXPECT_EQ(simulation->markers().size(), 60U);
  const std::int64_t end = simulation->frameCount();
  constexpr int kRooms = 6;
  constexpr int kInRoom = 8;
  constexpr double kShortest_px = 9.0;
  const slam::CameraModel camera(simulation->camera());
  std::array<std::optional<std::int64_t>, kRooms> first_seen_with_others;
  std::set<int> seen;
  for (std::int64_t k = 0; k < end; k += 3) {
    const slam::Transform T_w_c = simulation->poseAt(k);
    std::set<int> parts;  // rooms, and the corridor as kRooms
    for (const Marker& marker : simulation->visibleMarkers(k)) {
      if (shortestSide(*projectMarker(camera, T_w_c, marker)) < kShortest_px) continue;
      seen.insert(marker.id);
      parts.insert(std::min(marker.id / kInRoom, kRooms));
    }
    if (parts.size() < 2) continue;
    for (const int part : parts) {
      if (part == kRooms) continue;
      if (!first_seen_with_others[part]) first_seen_with_others[part] = k;
    }
  }
  EXPECT_GE(seen.size(), 59U);
  const auto back = static_cast<std::int64_t>(0.83 * static_cast<double>(end));
  int late = 0;
  for (int room = 0; room < kRooms; ++room) {
    ASSERT_TRUE(first_seen_with_others[room]) << "room " << room << " is never connected";
    late += *first_seen_with_others[room] > back ? 1 : 0;
  }
  EXPECT_GE(late, 4);
}

TEST(Corridor, Is25MetresThereAndBackWithAMarkerEveryNine) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const auto simulation = open("corridor", seed);
    const std::int64_t end = simulation->frameCount();
    const double walked = lengthOf(*simulation, 0, end);
    EXPECT_GT(walked, 49.0);
    EXPECT_LT(walked, 55.0);
    // A gap between each two neighbours; on the way back the end's is short.
    std::map<int, int> long_gaps;
    for (const auto& [from, to] : gapsOf(*simulation)) {
      const double length = lengthOf(*simulation, from, to);
      EXPECT_LT(length, 9.5) << "seed " << seed << " frame " << from;
      long_gaps[to * 2 < end ? 0 : 1] += length > 4.0;
    }
    EXPECT_GE(long_gaps[0], 3) << seed;
    EXPECT_GE(long_gaps[1], 2) << seed;
    EXPECT_GT(readable(*simulation, 0), 0U);
    EXPECT_GT(readable(*simulation, end - 1), 0U);
  }
}

// The head goes up and down 1.8 times a second while the walker walks.
TEST(Corridor, IsWalkedOnFoot) {
  const auto simulation = open("corridor");
  const Trajectory& pose = simulation->scene().trajectory;
  const auto bounce = [&](double from_s) {
    double in_phase = 0.0;
    double in_quadrature = 0.0;
    constexpr int kSamples = 500;
    for (int i = 0; i < kSamples; ++i) {
      const double t = from_s + 5.0 * i / kSamples;  // nine steps
      in_phase += pose(t).p.z() * std::cos(2.0 * M_PI * 1.8 * t) * 2.0 / kSamples;
      in_quadrature += pose(t).p.z() * std::sin(2.0 * M_PI * 1.8 * t) * 2.0 / kSamples;
    }
    return std::hypot(in_phase, in_quadrature);
  };
  EXPECT_NEAR(bounce(7.0), 0.02, 0.008);
}

TEST(Office, TurnsAwayFromItsMarkersAndComesBack) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const auto simulation = open("office", seed);
    EXPECT_EQ(simulation->markers().size(), 3U);
    const auto gaps = gapsOf(*simulation);
    ASSERT_EQ(gaps.size(), 1U) << seed;
    const auto [from, to] = gaps.front();
    const double seconds = static_cast<double>(to - from) / simulation->scene().rate_hz;
    EXPECT_GT(seconds, 10.0) << seed;
    EXPECT_LT(seconds, 20.0) << seed;
    const double speed = lengthOf(*simulation, from, to) / seconds;
    EXPECT_GT(speed, 0.3) << seed;
    EXPECT_LT(speed, 0.6) << seed;
    EXPECT_GT(to, from);
    EXPECT_GT(simulation->frameCount() - to, 60) << seed;
  }
}

TEST(Trouble, ComesWhenItIsSaidTo) {
  const auto simulation = open("trouble");
  const Scene& scene = simulation->scene();
  const auto image = [&](double t) { return Image(*simulation, frameAt(*simulation, t)); };

  const Interval blackout = eventOf(*simulation, "blackout");
  EXPECT_NEAR(blackout.end_s - blackout.begin_s, 1.0, 1e-9);
  EXPECT_LT(image(blackout.begin_s + 0.1).mean(), 6.0);
  EXPECT_GT(image(blackout.begin_s - 0.1).mean(), 60.0);
  EXPECT_GT(image(blackout.end_s + 0.05).mean(), 60.0);
  EXPECT_TRUE(simulation->isDark(frameAt(*simulation, blackout.begin_s + 0.5)));

  const Interval passing = eventOf(*simulation, "passer-by");
  EXPECT_GT(movingPart(*simulation, 0.5 * (passing.begin_s + passing.end_s)), 0.12);
  EXPECT_EQ(movingPart(*simulation, passing.begin_s - 0.5), 0.0);
  EXPECT_EQ(movingPart(*simulation, passing.end_s + 1.0), 0.0);

  const Interval things = eventOf(*simulation, "moving things");
  const double quarter_s = 0.25 * (things.end_s - things.begin_s);
  for (const double t : {things.begin_s + quarter_s, things.end_s - quarter_s}) {
    EXPECT_GT(movingPart(*simulation, t), 0.15);
    EXPECT_LT(movingPart(*simulation, t), 0.25);
  }
  EXPECT_EQ(movingPart(*simulation, things.begin_s - 0.5), 0.0);

  // Along the rows less is left than down the columns.
  const Interval blur = eventOf(*simulation, "blur");
  const Image sharp = image(blur.begin_s - 0.05);
  const Image blurred = image(blur.begin_s + 0.05);
  const double along = blurred.steepness(1, 0) / sharp.steepness(1, 0);
  EXPECT_LT(along, 0.3);
  EXPECT_GT(blurred.steepness(0, 1) / sharp.steepness(0, 1), 2.0 * along);

  const Interval stop = eventOf(*simulation, "stop");
  EXPECT_NEAR(stop.end_s - stop.begin_s, 5.0, 1e-9);
  const slam::Transform stopped = scene.trajectory(stop.begin_s);
  const Interval turn = eventOf(*simulation, "turn");
  EXPECT_NEAR(turn.end_s - turn.begin_s, 10.0, 1e-9);
  const slam::Transform before = scene.trajectory(turn.begin_s);
  double turned_rad = 0.0;
  for (double t = 0.0; t < 10.0; t += 0.05) {
    const slam::Transform still = scene.trajectory(stop.begin_s + 0.5 * t);
    EXPECT_LT((still.p - stopped.p).norm(), 1e-9);
    EXPECT_LT(slam::rotationDistance(still.R, stopped.R), 1e-6);
    const slam::Transform now = scene.trajectory(turn.begin_s + t);
    EXPECT_LT((now.p - before.p).norm(), 1e-9);
    turned_rad += slam::rotationDistance(now.R, scene.trajectory(turn.begin_s + t + 0.05).R);
  }
  EXPECT_NEAR(turned_rad, 2.0 * M_PI, 0.4);
}

// What happens is seen from between markers, and after it they are seen again.
TEST(Trouble, IsBetweenMarkers) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const auto simulation = open("trouble", seed);
    for (const char* what : {"blackout", "passer-by", "moving things", "blur", "stop"}) {
      const Interval when = eventOf(*simulation, what);
      for (double t = when.begin_s; t < when.end_s; t += 0.1) {
        EXPECT_EQ(readable(*simulation, frameAt(*simulation, t)), 0U)
            << what << " seed " << seed << " at " << t;
      }
    }
    const auto gaps = gapsOf(*simulation);
    EXPECT_GE(gaps.size(), 4U) << seed;
    for (const auto& [from, to] : gaps) {
      EXPECT_LT(to - from, 12 * 30) << "seed " << seed << " from frame " << from;
      EXPECT_LT(to, simulation->frameCount()) << seed;
    }
  }
}

// The bright dot around a pixel: its centre of brightness. Empty where there is none.
std::optional<Eigen::Vector2d> dotAt(const Image& image, const Eigen::Vector2d& pixel) {
  constexpr int kRadius = 7;
  const int x = static_cast<int>(std::lround(pixel.x()));
  const int y = static_cast<int>(std::lround(pixel.y()));
  if (image.at(x, y) < 150.0) return std::nullopt;
  double sum = 0.0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (int v = y - kRadius; v <= y + kRadius; ++v) {
    for (int u = x - kRadius; u <= x + kRadius; ++u) {
      const double weight = std::max(0.0, image.at(u, v) - 110.0);
      if (std::hypot(u - pixel.x(), v - pixel.y()) > kRadius) continue;
      sum += weight;
      centre += weight * Eigen::Vector2d(u, v);
    }
  }
  return centre / sum;
}

TEST(Table, ShowsItsTargetsWhereTheyAre) {
  for (const char* name : {"table", "table_fiducials"}) {
    const auto simulation = open(name);
    const Scene& scene = simulation->scene();
    ASSERT_EQ(scene.targets.size(), 11U);
    const slam::CameraModel camera(simulation->camera());
    for (const char* marker : {"A", "B", "C", "D", "E", "F"}) {
      const Interval when = eventOf(*simulation, std::string("table ") + marker);
      const std::int64_t frame = frameAt(*simulation, 0.5 * (when.begin_s + when.end_s));
      const Image image(*simulation, frame);
      const slam::Transform T_c_w = simulation->poseAt(frame).inverse();
      int seen = 0;
      for (const Target& target : scene.targets) {
        const auto pixel = camera.project(T_c_w * target.p_w);
        ASSERT_TRUE(pixel && camera.inImage(*pixel)) << target.name;
        const auto dot = dotAt(image, *pixel);
        if (!dot) continue;
        EXPECT_LT((*dot - *pixel).norm(), 0.5) << name << " target " << target.name;
        ++seen;
      }
      EXPECT_GE(seen, 9) << name << " " << marker;
    }
  }
}

// Each marker is looked at from its distance, in the middle of the image, facing the camera.
TEST(Table, VisitsItsMarkers) {
  const auto simulation = open("table");
  EXPECT_TRUE(simulation->markers().empty());
  const double distances_m[] = {0.45, 0.45, 0.8, 0.8, 1.0, 2.0};
  const double from_middle_m[] = {0.4, 0.4, 0.8, 0.8, 1.0, 2.0};
  for (std::size_t i = 0; i < 6; ++i) {
    const NaturalPicture& natural = simulation->scene().natural[i];
    EXPECT_NEAR(natural.T_w_m->p.norm(), from_middle_m[i], 0.06) << natural.name;
    const Interval when = eventOf(*simulation, "marker " + natural.name);
    for (const double t : {when.begin_s + 0.5, when.end_s}) {
      const slam::Transform T_c_m = simulation->scene().trajectory(t).inverse() * *natural.T_w_m;
      EXPECT_NEAR(T_c_m.p.norm(), distances_m[i], 0.25 * distances_m[i]) << natural.name;
      EXPECT_LT(std::hypot(T_c_m.p.x(), T_c_m.p.y()), 0.3 * T_c_m.p.z()) << natural.name;
      EXPECT_LT(T_c_m.R.col(2).z(), -0.8) << natural.name;
    }
  }
  const auto fiducials = open("table_fiducials");
  ASSERT_EQ(fiducials->markers().size(), 6U);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_LT((fiducials->markers()[i].T_w_m.p - simulation->scene().natural[i].T_w_m->p).norm(),
              0.005);
    const Interval when = eventOf(*fiducials, "marker " + simulation->scene().natural[i].name);
    EXPECT_GT(readable(*fiducials, frameAt(*fiducials, when.end_s)), 0U);
  }
}

// A bright square on a dark surface that moves: it is where it has come to, at each row's time.
TEST(Renderer, ShowsASurfacesImageWhereItHasMovedTo) {
  std::vector<std::uint8_t> grey(200 * 100, 0);
  for (int y = 47; y < 53; ++y) {
    for (int x = 97; x < 103; ++x) grey[static_cast<std::size_t>(200 * y + x)] = 255;
  }
  Scene scene = testing::bareScene("surface");
  scene.camera.distortion = {-0.2, 0.05, 0.0005, -0.0007};
  Surface surface;
  surface.half_width_m = 0.4;
  surface.half_height_m = 0.2;
  surface.image = std::make_shared<PrintedImage>(ImageView{grey.data(), 200, 100, 200}, 0.0, 255.0);
  slam::Transform T_w_s;
  T_w_s.R << 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0;
  T_w_s.R = slam::expSo3({0.1, -0.3, 0.2}) * T_w_s.R;
  T_w_s.p = {0.02, 0.01, 0.6};
  constexpr double kSpeed = 0.1;  // metres per second, along x
  surface.motion = [=](double t) {
    slam::Transform moved = T_w_s;
    moved.p.x() += kSpeed * t;
    return moved;
  };
  surface.T_w_s = T_w_s;
  scene.surfaces.push_back(surface);
  constexpr int kMargin = 2;
  const auto renderer = Renderer::create(scene, 1, kMargin);
  ASSERT_TRUE(renderer.ok());
  const slam::CameraModel camera(scene.camera);
  Renderer::Workspace workspace;
  const auto bright = [&](const RowPoses& poses) {
    renderer->render(poses, {}, &workspace);
    double sum = 0.0;
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
    for (int y = 0; y < workspace.radiance.height; ++y) {
      for (int x = 0; x < workspace.radiance.width; ++x) {
        const double level = workspace.radiance.row(y)[x];
        // Outside the surface there is a grey of its own.
        const Eigen::Vector2d pixel(x - kMargin, y - kMargin);
        if ((pixel - Eigen::Vector2d(168.0, 122.0)).norm() > 60.0) continue;
        sum += level;
        centre += level * pixel;
      }
    }
    return Eigen::Vector2d(centre / sum);
  };
  for (const double t : {0.0, 0.3}) {
    RowPoses poses{.T_w_c = {slam::Transform{}}, .first_s = t};
    const Eigen::Vector2d truth = *camera.project(surface.motion(t).p);
    EXPECT_LT((bright(poses) - truth).norm(), 0.1) << t;
  }
  // Rows in turn: the square's own row counts, 0.002 s a row from the table's first.
  RowPoses rolling{.T_w_c = std::vector<slam::Transform>(240 + 2 * kMargin), .row_s = 0.002};
  const double row = camera.project(T_w_s.p)->y() + kMargin;
  EXPECT_LT((bright(rolling) - *camera.project(surface.motion(0.002 * row).p)).norm(), 0.1);
}

TEST(Sensor, SmearsALineEvenly) {
  Radiance light{41, 2, std::vector<float>(82, 0.0F)};
  light.row(0)[20] = 160.0F;
  light.row(1)[20] = 160.0F;
  smearRows(8.0, &light);
  EXPECT_EQ(smearRadius(8.0), 4);
  for (int x = 0; x < 41; ++x) {
    const int apart = std::abs(x - 20);
    EXPECT_FLOAT_EQ(light.row(0)[x], apart < 4 ? 20.0F : (apart == 4 ? 10.0F : 0.0F)) << x;
  }
  EXPECT_EQ(smearRadius(0.0), 0);
  const std::vector<float> before = light.pixels;
  smearRows(0.0, &light);
  EXPECT_EQ(light.pixels, before);
}

}  // namespace
}  // namespace waymark::simulator
