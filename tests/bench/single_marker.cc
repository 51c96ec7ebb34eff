// One small marker far away, and nothing else: its other pose explains the image nearly as well.
// How many frames get a pose, how many of these are the wrong one, and how many of those without
// saying so: neither an ambiguity ratio below 3 nor a covariance that reaches to the truth. Live,
// and at the end, when each frame is decided by those before and after.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>

#include "simulator/observed_corners.h"
#include "simulator/random.h"
#include "slam/final_trajectory.h"
#include "slam/marker_pose/square_pose.h"
#include "slam/slam.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

struct Arguments {
  int approaches = 100;
  int frames = 200;  // of each, at 30 a second
  std::uint64_t seed = 1;
  std::vector<double> sigmas_px = {0.05, 0.1, 0.2, 0.4};
};

constexpr double kSize_m = 0.12;
constexpr double kFocal_px = 520.0;

// From a side of 8 pixels to one of 25, the marker turned by up to 40 degrees.
struct Approach {
  Approach(std::uint64_t seed, int frames_) : frames(frames_) {
    simulator::Random random(seed, 0x464c4950);
    tilt_rad = random.uniform(0.0, 40.0) * std::numbers::pi / 180.0;
    axis_rad = random.uniform(-std::numbers::pi, std::numbers::pi);
    for (double& phase : phases) phase = random.uniform(0.0, 2.0 * std::numbers::pi);
  }

  [[nodiscard]] slam::Transform at(int frame) const {
    const double s = static_cast<double>(frame) / frames;
    const double side_px = 8.0 + 17.0 * s;
    const double distance_m = kFocal_px * kSize_m / side_px;
    const double t = frame / 30.0;
    const auto sway = [&](int i) { return std::sin((1.0 + 0.3 * i) * t + phases[i]); };
    // The marker is at the origin, its face along z; the camera looks at it, from the side.
    const Eigen::Vector3d axis(std::cos(axis_rad), std::sin(axis_rad), 0.0);
    const double tilt = tilt_rad + 0.03 * sway(0);
    const Eigen::Vector3d eye = slam::expSo3(tilt * axis) * Eigen::Vector3d(0.0, 0.0, distance_m);
    slam::Transform T_w_c;
    const Eigen::Vector3d z = -eye.normalized();
    const Eigen::Vector3d x = Eigen::Vector3d::UnitY().cross(z).normalized() * -1.0;
    T_w_c.R << x, z.cross(x), z;
    T_w_c.R = T_w_c.R * slam::expSo3({0.05 * sway(1), 0.05 * sway(2), 0.1 * sway(3)});
    T_w_c.p = eye + 0.02 * Eigen::Vector3d(sway(4), sway(5), 0.0);
    return T_w_c;
  }

  int frames;
  double tilt_rad, axis_rad;
  double phases[6];
};

struct Tally {
  int frames = 0, posed = 0, beyond = 0, unwarned = 0, flipped = 0, silent = 0;
};

// What is told of a frame, held against where it was.
void count(const std::optional<slam::PoseEstimate>& pose, const slam::Transform& truth,
           const slam::CameraModel& camera, const std::vector<simulator::Marker>& markers,
           Tally* tally) {
  ++tally->frames;
  if (!pose) return;
  ++tally->posed;
  const slam::Vector6d error = pose->T_w_c.localCoordinates(truth);
  const Eigen::LLT<slam::Matrix6d> factor(pose->covariance);
  const double nees = error.dot(factor.solve(error));
  constexpr double kReaches = 30.0;  // chi-square of 6 dimensions: 99.996 %
  if (nees < kReaches) return;
  ++tally->beyond;
  const bool warned = pose->ambiguity_ratio < 3.0;
  if (!warned) ++tally->unwarned;
  const auto exact = simulator::observeCorners(camera, truth, markers, 0, {.sigma_px = 1e-6});
  const auto other = slam::otherSquarePose(exact.front(), kSize_m, truth.inverse());
  if (!other || slam::rotationDistance(pose->T_w_c.R, other->inverse().R) >
                    slam::rotationDistance(pose->T_w_c.R, truth.R)) {
    return;
  }
  ++tally->flipped;
  if (!warned) ++tally->silent;
}

struct Tallies {
  Tally live, at_the_end;
};

void follow(const Approach& approach, double sigma_px, std::uint64_t seed, Tallies* tallies) {
  const slam::CameraModel camera(
      {.width = 640, .height = 480, .fx = kFocal_px, .fy = kFocal_px, .cx = 320.0, .cy = 240.0});
  slam::Map map;
  map.addMarker(1, kSize_m);
  map.place(1, slam::Transform{});
  slam::Options options;
  options.markers.size_m = kSize_m;
  options.mapping = false;
  slam::Slam slam(camera, *slam::Dictionary::byName("4X4_50"), options, map);
  const std::vector<simulator::Marker> markers = {{1, kSize_m, slam::Transform{}}};
  std::vector<slam::LiveFrame> frames;
  for (int k = 0; k < approach.frames; ++k) {
    const auto sequence = static_cast<std::uint64_t>(k);
    auto seen = simulator::observeCorners(camera, approach.at(k), markers, sequence,
                                          {.sigma_px = sigma_px, .seed = seed});
    const std::int64_t time_ns = static_cast<std::int64_t>(k) * 33'333'333;
    auto result = slam.process({.time = {sequence, time_ns}, .detections = seen});
    count(result.pose, approach.at(k), camera, markers, &tallies->live);
    frames.push_back({time_ns, std::move(result.pose), std::move(seen)});
  }
  const auto all = slam::localizeAll(frames, {}, slam);
  for (int k = 0; k < approach.frames; ++k) {
    count(all[static_cast<std::size_t>(k)].pose, approach.at(k), camera, markers,
          &tallies->at_the_end);
  }
}

void print(double sigma_px, const char* when, const Tally& tally) {
  std::printf("%9.2f %6s %8d %8d %8d %8d %8d %8d\n", sigma_px, when, tally.frames, tally.posed,
              tally.beyond, tally.unwarned, tally.flipped, tally.silent);
}

tools::ExitCode run(const Arguments& arguments) {
  std::printf("%9s %6s %8s %8s %8s %8s %8s %8s\n", "sigma px", "", "frames", "posed", "beyond",
              "unwarned", "flipped", "silent");
  for (const double sigma_px : arguments.sigmas_px) {
    Tallies tallies;
    for (int i = 0; i < arguments.approaches; ++i) {
      const std::uint64_t seed = arguments.seed + static_cast<std::uint64_t>(i);
      follow(Approach(seed, arguments.frames), sigma_px, seed, &tallies);
    }
    print(sigma_px, "live", tallies.live);
    print(sigma_px, "final", tallies.at_the_end);
  }
  return tools::kDone;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Wrong poses of a single small marker", "single_marker"};
  app.add_option("--approaches", arguments.approaches)
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--frames", arguments.frames, "Of each approach")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed)->capture_default_str();
  app.add_option("--sigma", arguments.sigmas_px, "Noise of the corners, pixels")
      ->check(CLI::PositiveNumber);
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(arguments);
}
