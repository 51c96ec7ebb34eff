#include "tests/bench/walk.h"

#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "simulator/observed_corners.h"
#include "simulator/random.h"
#include "simulator/simulation.h"
#include "simulator/trajectory.h"

namespace waymark::bench {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

constexpr int kColumns = 50;  // of markers, a metre apart
constexpr int kRows = 40;
constexpr double kCeiling_m = 5.0;
constexpr double kEye_m = 1.5;
constexpr double kLane_m = 2.5;  // between lanes: the image is 3.3 m high on the ceiling
constexpr double kStep_m = 1.25;
constexpr double kSpeed_m_s = 1.5;

std::vector<simulator::Marker> hangUnderCeiling(double size_m, std::uint64_t seed) {
  simulator::Random random(seed, 0x48414c4c);
  std::vector<simulator::Marker> markers;
  for (int i = 0; i < kColumns * kRows; ++i) {
    // Face down, a little crooked.
    slam::Transform T_w_m;
    const Vector3d tilt(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1),
                        random.uniform(-std::numbers::pi, std::numbers::pi));
    T_w_m.R = Vector3d(1.0, -1.0, -1.0).asDiagonal() * slam::expSo3(tilt);
    const int column = i % kColumns;
    const int row = i / kColumns;
    T_w_m.p = {column + random.uniform(-0.3, 0.3), row + random.uniform(-0.3, 0.3), kCeiling_m};
    markers.push_back({i, size_m, T_w_m});
  }
  return markers;
}

// Lane after lane, to and fro, and back to the start along the side.
simulator::ClosedSpline lanes() {
  std::vector<Vector4d> knots;
  const auto straight = [&](double x0, double y0, double x1, double y1) {
    const int steps = static_cast<int>(std::round(std::hypot(x1 - x0, y1 - y0) / kStep_m));
    for (int i = 0; i < steps; ++i) {
      const double s = static_cast<double>(i) / steps;
      knots.emplace_back(x0 + s * (x1 - x0), y0 + s * (y1 - y0), 0.0, 0.0);
    }
  };
  constexpr double kNear = 0.25;
  constexpr double kSide = 0.75;
  constexpr double kFar = kColumns - 1.25;
  constexpr int kLanes = 16;  // even: the last one ends at the side the first began at
  double y = kSide;
  for (int lane = 0; lane < kLanes; ++lane) {
    const bool away = lane % 2 == 0;
    straight(away ? kNear : kFar, y, away ? kFar : kNear, y);
    if (lane + 1 == kLanes) break;
    straight(away ? kFar : kNear, y, away ? kFar : kNear, y + kLane_m);
    y += kLane_m;
  }
  straight(kNear, y, kNear, kSide);
  return {std::move(knots), Vector4d::Zero()};
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
                                      const std::vector<simulator::Marker>& markers) {
  constexpr double kFarthest_m = 8.0;  // of what a camera can see of the ceiling
  std::vector<simulator::Marker> near;
  for (const simulator::Marker& marker : markers) {
    if ((marker.T_w_m.p - T_w_c.p).norm() < kFarthest_m) near.push_back(marker);
  }
  constexpr double kExact_px = 1e-9;
  std::vector<simulator::Marker> seen;
  for (const slam::MarkerDetection& detection :
       simulator::observeCorners(camera, T_w_c, near, 0, {.sigma_px = kExact_px})) {
    seen.push_back(markers[static_cast<std::size_t>(detection.id)]);
  }
  return seen;
}

}  // namespace

Walk walkThroughHall(std::uint64_t seed) {
  Walk walk;
  walk.camera = {.width = 640, .height = 480, .fx = 512.0, .fy = 513.0, .cx = 323.0, .cy = 236.0};
  walk.camera.distortion = {-0.20, 0.05, 0.0005, -0.0007};
  walk.rate_hz = 30.0;
  walk.marker_size_m = 0.25;
  walk.markers = hangUnderCeiling(walk.marker_size_m, seed);

  const simulator::ClosedSpline way = lanes();
  const double duration_s = lengthOf(way) / kSpeed_m_s;
  const simulator::Sway sway(seed, duration_s,
                             {.position_m = 0.15, .yaw = 0.15, .pitch = 0.12, .roll = 0.12});
  const auto frames = static_cast<int>(duration_s * walk.rate_hz);
  const slam::CameraModel camera(walk.camera);
  for (int i = 0; i < frames; ++i) {
    const double s = static_cast<double>(i) / frames;
    const Vector4d at = way.at(s);
    constexpr double kUp = 0.45 * std::numbers::pi;
    Walk::Frame frame;
    frame.T_w_c = simulator::cameraPose(
        sway.apply({{at.x(), at.y(), kEye_m}, 0.0, kUp, 0.0}, s * duration_s));
    frame.in_view = inView(camera, frame.T_w_c, walk.markers);
    walk.frames.push_back(std::move(frame));
  }
  return walk;
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
