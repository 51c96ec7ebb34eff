#include "tests/bench/walk.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <span>
#include <utility>

#include "simulator/observed_corners.h"
#include "simulator/random.h"
#include "simulator/simulation.h"
#include "simulator/trajectory.h"

namespace waymark::bench {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

constexpr double kCeiling_m = 5.0;
constexpr double kEye_m = 1.5;
constexpr double kStep_m = 1.25;
constexpr double kSpeed_m_s = 1.5;

// Markers on a ceiling, a metre apart.
struct Ceiling {
  int columns = 0;
  int rows = 0;
  double left_m = 0.0;  // x of the first column
  int first_id = 0;

  [[nodiscard]] double near_m() const { return left_m + 0.25; }
  [[nodiscard]] double far_m() const { return left_m + columns - 1.25; }
  // To and fro, so that the last one ends at the side the first began at; no farther apart than
  // 2.5 m: the image is 3.3 m high on the ceiling.
  [[nodiscard]] int lanes() const { return 2 * ((rows + 4) / 5); }
  [[nodiscard]] double lane_m() const { return (rows - 2.5) / (lanes() - 1); }
};
constexpr double kSide_m = 0.75;  // y of the first lane
constexpr Ceiling kHall{.columns = 50, .rows = 40};

std::vector<simulator::Marker> hangUnder(const Ceiling& ceiling, int count, double size_m,
                                         simulator::Random* random) {
  std::vector<simulator::Marker> markers;
  for (int i = 0; i < count; ++i) {
    // Face down, a little crooked.
    slam::Transform T_w_m;
    const Vector3d tilt(random->uniform(-0.1, 0.1), random->uniform(-0.1, 0.1),
                        random->uniform(-std::numbers::pi, std::numbers::pi));
    T_w_m.R = Vector3d(1.0, -1.0, -1.0).asDiagonal() * slam::expSo3(tilt);
    const int column = i % ceiling.columns;
    const int row = i / ceiling.columns;
    T_w_m.p = {ceiling.left_m + column + random->uniform(-0.3, 0.3),
               row + random->uniform(-0.3, 0.3), kCeiling_m};
    markers.push_back({ceiling.first_id + i, size_m, T_w_m});
  }
  return markers;
}

using Knots = std::vector<Vector4d>;

// Without the end, where the next one begins.
void addStraight(double x0, double y0, double x1, double y1, Knots* knots) {
  const int steps = static_cast<int>(std::round(std::hypot(x1 - x0, y1 - y0) / kStep_m));
  for (int i = 0; i < steps; ++i) {
    const double s = static_cast<double>(i) / steps;
    knots->emplace_back(x0 + s * (x1 - x0), y0 + s * (y1 - y0), 0.0, 0.0);
  }
}

// Lane after lane, to and fro, and back to the start along the side.
Knots lanesUnder(const Ceiling& ceiling) {
  Knots knots;
  double y = kSide_m;
  for (int lane = 0; lane < ceiling.lanes(); ++lane) {
    const bool away = lane % 2 == 0;
    const double from = away ? ceiling.near_m() : ceiling.far_m();
    const double to = away ? ceiling.far_m() : ceiling.near_m();
    addStraight(from, y, to, y, &knots);
    if (lane + 1 == ceiling.lanes()) break;
    addStraight(to, y, to, y + ceiling.lane_m(), &knots);
    y += ceiling.lane_m();
  }
  addStraight(ceiling.near_m(), y, ceiling.near_m(), kSide_m, &knots);
  return knots;
}

// From where the lanes of the second one begin: through both, and back along the next lane.
Knots throughBoth(const Ceiling& first, const Ceiling& second) {
  Knots knots;
  const double back = kSide_m + second.lane_m();
  addStraight(second.near_m(), kSide_m, first.near_m(), kSide_m, &knots);
  addStraight(first.near_m(), kSide_m, first.near_m(), back, &knots);
  addStraight(first.near_m(), back, second.far_m(), back, &knots);
  addStraight(second.far_m(), back, second.far_m(), kSide_m, &knots);
  addStraight(second.far_m(), kSide_m, second.near_m(), kSide_m, &knots);
  return knots;
}

double lengthOf(const simulator::ClosedSpline& way) {
  constexpr int kPieces = 20'000;
  double length_m = 0.0;
  for (int i = 0; i < kPieces; ++i) {
    length_m += (way.at((i + 1.0) / kPieces) - way.at(static_cast<double>(i) / kPieces)).norm();
  }
  return length_m;
}

// Kept for every frame, so only those that are.
std::vector<simulator::Marker> inView(const slam::CameraModel& camera, const slam::Transform& T_w_c,
                                      std::span<const simulator::Marker> markers) {
  constexpr double kFarthest_m = 8.0;  // of what a camera can see of the ceiling
  std::vector<simulator::Marker> near;
  for (const simulator::Marker& marker : markers) {
    if ((marker.T_w_m.p - T_w_c.p).norm() < kFarthest_m) near.push_back(marker);
  }
  constexpr double kExact_px = 1e-9;
  std::vector<simulator::Marker> seen;
  for (const slam::MarkerDetection& detection :
       simulator::observeCorners(camera, T_w_c, near, 0, {.sigma_px = kExact_px})) {
    seen.push_back(*std::ranges::find(near, detection.id, &simulator::Marker::id));
  }
  return seen;
}

// Below the ceilings, at an even pace: one time round.
class CeilingCamera {
 public:
  CeilingCamera(const Walk& walk, Knots knots, std::uint64_t seed)
      : camera_(walk.camera),
        way_(std::move(knots), Vector4d::Zero()),
        duration_s_(lengthOf(way_) / kSpeed_m_s),
        sway_(seed, duration_s_, {.position_m = 0.15, .yaw = 0.15, .pitch = 0.12, .roll = 0.12}),
        frames_(static_cast<int>(duration_s_ * walk.rate_hz)) {}

  [[nodiscard]] int frames() const { return frames_; }
  // What it sees of these markers.
  [[nodiscard]] Walk::Frame frame(int index, std::span<const simulator::Marker> markers) const {
    const double s = static_cast<double>(index) / frames_;
    const Vector4d at = way_.at(s);
    constexpr double kUp = 0.45 * std::numbers::pi;
    Walk::Frame frame;
    frame.T_w_c = simulator::cameraPose(
        sway_.apply({{at.x(), at.y(), kEye_m}, 0.0, kUp, 0.0}, s * duration_s_));
    frame.in_view = inView(camera_, frame.T_w_c, markers);
    return frame;
  }

 private:
  slam::CameraModel camera_;
  simulator::ClosedSpline way_;
  double duration_s_;
  simulator::Sway sway_;
  int frames_;
};

Walk emptyWalk(double rate_hz) {
  Walk walk;
  walk.camera = {.width = 640, .height = 480, .fx = 512.0, .fy = 513.0, .cx = 323.0, .cy = 236.0};
  walk.camera.distortion = {-0.20, 0.05, 0.0005, -0.0007};
  walk.rate_hz = rate_hz;
  walk.marker_size_m = 0.25;
  return walk;
}

}  // namespace

Walk walkThroughHall(std::uint64_t seed) {
  Walk walk = emptyWalk(30.0);
  simulator::Random random(seed, 0x48414c4c);
  walk.markers = hangUnder(kHall, kHall.columns * kHall.rows, walk.marker_size_m, &random);
  const CeilingCamera camera(walk, lanesUnder(kHall), seed);
  for (int i = 0; i < camera.frames(); ++i) walk.frames.push_back(camera.frame(i, walk.markers));
  return walk;
}

TwoHalls walkThroughTwoHalls(int markers_each, double rate_hz, std::uint64_t seed) {
  constexpr double kWidthPerDepth = 1.25;
  constexpr double kDark_s = 2.0;
  Ceiling first;
  first.columns = static_cast<int>(std::ceil(std::sqrt(kWidthPerDepth * markers_each)));
  first.rows = (markers_each + first.columns - 1) / first.columns;
  Ceiling second = first;
  second.left_m = first.columns;
  second.first_id = markers_each;

  TwoHalls halls{emptyWalk(rate_hz)};
  Walk& walk = halls.walk;
  simulator::Random random(seed, 0x32484c53);
  const auto in_first = hangUnder(first, markers_each, walk.marker_size_m, &random);
  const auto in_second = hangUnder(second, markers_each, walk.marker_size_m, &random);
  walk.markers = in_first;
  walk.markers.insert(walk.markers.end(), in_second.begin(), in_second.end());

  const CeilingCamera in_the_first(walk, lanesUnder(first), seed);
  for (int i = 0; i < in_the_first.frames(); ++i) {
    walk.frames.push_back(in_the_first.frame(i, in_first));
  }
  const auto dark = static_cast<std::size_t>(kDark_s * rate_hz);
  walk.frames.resize(walk.frames.size() + dark, {walk.frames.back().T_w_c, {}});
  // As one way round, so that nothing jumps where the door opens.
  Knots knots = lanesUnder(second);
  const std::size_t door = knots.size();
  const Knots both = throughBoth(first, second);
  knots.insert(knots.end(), both.begin(), both.end());
  const double open_from = static_cast<double>(door) / static_cast<double>(knots.size());
  const CeilingCamera on(walk, std::move(knots), seed);
  const auto opens = static_cast<int>(open_from * on.frames());
  halls.door_opens = walk.frames.size() + static_cast<std::size_t>(opens);
  for (int i = 0; i < on.frames(); ++i) {
    walk.frames.push_back(on.frame(i, i < opens ? in_second : walk.markers));
  }
  return halls;
}

Result<Walk> planWalk(const WalkOptions& options) {
  if (options.scene == "hall") return walkThroughHall(options.seed);
  simulator::Options asked;
  asked.scene = options.scene;
  asked.seed = options.seed;
  asked.duration_s = options.loop_s;
  const auto simulation = simulator::Simulation::create(asked, simulator::Ending::kClosedLoop);
  if (!simulation) return simulation.error();
  Walk walk;
  walk.camera = (*simulation)->camera();
  walk.rate_hz = (*simulation)->scene().rate_hz;
  walk.markers = (*simulation)->markers();
  walk.marker_size_m = walk.markers.front().size_m;
  for (std::int64_t k = 0; k < (*simulation)->frameCount(); ++k) {
    walk.frames.push_back({(*simulation)->poseAt(k), (*simulation)->visibleMarkers(k)});
  }
  return walk;
}

}  // namespace waymark::bench
