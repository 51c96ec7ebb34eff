// What is known of the markers besides their views, and what it is worth: somebody walks once along
// a corridor with markers on one wall only, and never comes back. How far are the markers at its
// far end from where they are, where the first quarter of the map lies on the truth, with nothing
// known, with the wall, with two distances along a tape, and with both?
//
//   constraints [--length 40] [--runs 3] [--json FILE]
//
// Wall, tape and prints are as good as the defaults of MarkerConstraints say. Corners are projected
// from the truth, with noise.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <nlohmann/json.hpp>

#include "io/text/text_file.h"
#include "simulator/observed_corners.h"
#include "simulator/random.h"
#include "slam/final_map.h"
#include "slam/geometry/align_points.h"
#include "slam/slam.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using Eigen::Vector3d;

constexpr double kRate_hz = 30.0;
constexpr double kSpeed_m_s = 1.0;
constexpr double kMarker_m = 0.16;
constexpr double kFromWall_m = 1.6;
constexpr double kEye_m = 1.5;
constexpr int kAtTheEnd = 3;  // markers that are told of

struct Arguments {
  double length_m = 40.0;
  double spacing_m = 1.0;
  int runs = 3;
  std::uint64_t seed = 1;
  double sigma_px = 0.3;
  std::string json;
};

slam::Calibration camera640() {
  return {.width = 640, .height = 480, .fx = 520.0, .fy = 520.0, .cx = 319.5, .cy = 239.5};
}

// The wall is y = 0, and the camera where y is larger; x along it, z up.
struct Corridor {
  std::vector<simulator::Marker> markers;
  std::vector<slam::Transform> T_s_c;  // by frame; s: the corridor
  std::vector<slam::CornerDistance> tape;
};

std::vector<simulator::Marker> hang(const Arguments& arguments, simulator::Random* random) {
  const slam::MarkerPlane wall;
  const slam::UprightMarkers upright;
  const int count = 1 + static_cast<int>(std::round(arguments.length_m / arguments.spacing_m));
  std::vector<simulator::Marker> markers;
  for (int id = 0; id < count; ++id) {
    slam::Transform T_s_m;
    T_s_m.R << -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0;  // x right, y up, z out of the wall
    const Vector3d turn(wall.sigma_rad * random->gaussian(), upright.sigma_rad * random->gaussian(),
                        wall.sigma_rad * random->gaussian());
    T_s_m.R = slam::expSo3(turn) * T_s_m.R;
    T_s_m.p = {id * arguments.spacing_m, wall.sigma_m * random->gaussian(),
               random->uniform(1.2, 1.8)};
    markers.push_back({id, kMarker_m, T_s_m});
  }
  return markers;
}

// Half ahead, half at the wall; the hand sways.
std::vector<slam::Transform> walk(const Arguments& arguments, simulator::Random* random) {
  std::vector<double> phases(6);
  for (double& phase : phases) phase = random->uniform(0.0, 2.0 * std::numbers::pi);
  std::vector<slam::Transform> views;
  const auto frames = static_cast<int>(arguments.length_m / kSpeed_m_s * kRate_hz);
  for (int k = 0; k < frames; ++k) {
    const double t = k / kRate_hz;
    const auto sway = [&](std::size_t i, double hz) {
      return std::sin(2.0 * std::numbers::pi * hz * t + phases[i]);
    };
    const Vector3d eye(kSpeed_m_s * t - 0.8 + 0.03 * sway(0, 0.9),
                       kFromWall_m + 0.08 * sway(1, 0.3), kEye_m + 0.03 * sway(2, 1.8));
    const double yaw = -0.85 + 0.1 * sway(3, 0.2);
    const double pitch = 0.05 * sway(4, 0.4);
    const Vector3d z(std::cos(yaw) * std::cos(pitch), std::sin(yaw) * std::cos(pitch),
                     std::sin(pitch));
    const Vector3d x = z.cross(Vector3d::UnitZ()).normalized();
    slam::Transform T_s_c;
    T_s_c.R << x, z.cross(x), z;
    T_s_c.R = slam::expSo3(0.03 * sway(5, 0.5) * z) * T_s_c.R;
    T_s_c.p = eye;
    views.push_back(T_s_c);
  }
  return views;
}

slam::CornerDistance measure(const Corridor& corridor, std::size_t a, std::size_t b,
                             simulator::Random* random) {
  const auto corners = slam::markerCorners(kMarker_m);
  slam::CornerDistance distance{
      .id_a = corridor.markers[a].id, .corner_a = 0, .id_b = corridor.markers[b].id, .corner_b = 0};
  distance.distance_m =
      (corridor.markers[a].T_w_m * corners[0] - corridor.markers[b].T_w_m * corners[0]).norm() +
      distance.sigma_m * random->gaussian();
  return distance;
}

Corridor build(const Arguments& arguments, std::uint64_t seed) {
  simulator::Random random(seed, 0x77616c6c);
  Corridor corridor{hang(arguments, &random), walk(arguments, &random), {}};
  const std::size_t last = corridor.markers.size() - 1;
  corridor.tape = {measure(corridor, 0, last / 2, &random),
                   measure(corridor, last / 2, last, &random)};
  return corridor;
}

struct Knowledge {
  std::string name;
  std::function<void(const Corridor&, slam::MarkerConstraints*)> add;
};

void addWall(const Corridor& corridor, slam::MarkerConstraints* known) {
  known->planes = {{.name = "wall", .ids = {{0, corridor.markers.back().id}}}};
}
void addTape(const Corridor& corridor, slam::MarkerConstraints* known) {
  known->distances = corridor.tape;
}
std::vector<Knowledge> allKnowledge() {
  return {{"nothing", [](const Corridor&, slam::MarkerConstraints*) {}},
          {"one plane", addWall},
          {"two distances", addTape},
          {"one plane, two distances", [](const Corridor& c, slam::MarkerConstraints* known) {
             addWall(c, known);
             addTape(c, known);
           }}};
}

// Of the markers at the far end, on the average.
struct Drift {
  double along_mm = 0.0, out_mm = 0.0, up_mm = 0.0;  // signs are those of the mean
  double distance_mm = 0.0;
  // In the world of the first keyframe: the root of the sum of the variances that the map tells of
  // a position, and its normalized error squared, 3 where that is true.
  double sigma_mm = 0.0;
  double nees = 0.0;
};

// From the map to the corridor, by the markers of its first quarter.
slam::Transform alignStart(const Arguments& arguments, const Corridor& corridor,
                           const slam::Map& map) {
  std::vector<Vector3d> in_map;
  std::vector<Vector3d> in_corridor;
  const auto corners = slam::markerCorners(kMarker_m);
  for (const simulator::Marker& truth : corridor.markers) {
    const slam::MapMarker* const marker = map.findPosed(truth.id);
    if (marker == nullptr || truth.T_w_m.p.x() > 0.25 * arguments.length_m) continue;
    for (const Vector3d& corner : corners) {
      in_map.push_back(*marker->T_w_m * corner);
      in_corridor.push_back(truth.T_w_m * corner);
    }
  }
  return slam::alignPoints(in_map, in_corridor);
}

Drift driftOf(const Arguments& arguments, const Corridor& corridor, const slam::Map& map) {
  const slam::Keyframe& first = map.keyframes().begin()->second;
  const slam::Transform T_s_w = alignStart(arguments, corridor, map);
  const slam::Transform T_w_s = first.T_w_c * corridor.T_s_c[first.sequence].inverse();
  Drift drift;
  int count = 0;
  for (std::size_t i = corridor.markers.size(); i-- > 0 && count < kAtTheEnd;) {
    const Vector3d& truth = corridor.markers[i].T_w_m.p;
    const slam::MapMarker* const marker = map.findPosed(corridor.markers[i].id);
    if (marker == nullptr) continue;
    ++count;
    const Vector3d error = T_s_w * marker->T_w_m->p - truth;
    drift.along_mm += 1000.0 * error.x() / kAtTheEnd;
    drift.out_mm += 1000.0 * error.y() / kAtTheEnd;
    drift.up_mm += 1000.0 * error.z() / kAtTheEnd;
    drift.distance_mm += 1000.0 * error.norm() / kAtTheEnd;
    const Vector3d in_world = marker->T_w_m->p - T_w_s * truth;
    const Eigen::Matrix3d covariance = marker->world_covariance.topLeftCorner<3, 3>();
    drift.sigma_mm += 1000.0 * std::sqrt(covariance.trace()) / kAtTheEnd;
    drift.nees += in_world.dot(covariance.ldlt().solve(in_world)) / kAtTheEnd;
  }
  return drift;
}

struct Outcome {
  Drift live, final;
  std::uint64_t gated = 0;  // constraints, in local optimizations
  std::size_t localized = 0;
  std::size_t frames = 0;
};

Outcome run(const Arguments& arguments, const Corridor& corridor, const Knowledge& knowledge,
            std::uint64_t seed) {
  const slam::CameraModel camera(camera640());
  slam::Options options;
  options.markers.size_m = kMarker_m;
  options.covariance.repeated_share = 0.0;  // each view's noise is its own
  knowledge.add(corridor, &options.markers.constraints);
  slam::Slam slam(camera, *slam::Dictionary::byName("APRILTAG_36h11"), options);
  const simulator::ObservationOptions noise{.sigma_px = arguments.sigma_px, .seed = seed};
  std::vector<slam::LiveFrame> frames;
  Outcome outcome;
  for (std::size_t k = 0; k < corridor.T_s_c.size(); ++k) {
    slam::LiveFrame frame;
    frame.monotonic_ns = static_cast<std::int64_t>(1e9 * static_cast<double>(k) / kRate_hz);
    frame.detections =
        simulator::observeCorners(camera, corridor.T_s_c[k], corridor.markers, k, noise);
    frame.pose =
        slam.process({.time = {k, frame.monotonic_ns}, .detections = frame.detections}).pose;
    if (frame.pose) ++outcome.localized;
    frames.push_back(std::move(frame));
  }
  outcome.frames = frames.size();
  slam.finish();
  outcome.live = driftOf(arguments, corridor, slam.map());
  slam::makeFinalMap(frames, {}, &slam);
  outcome.final = driftOf(arguments, corridor, slam.map());
  outcome.gated = slam.counters().gated_constraints;
  return outcome;
}

void print(std::uint64_t seed, const std::string& known, const Outcome& outcome) {
  const Drift& d = outcome.final;
  std::printf("%4llu %-34s %7.1f %7.1f %7.1f %7.1f %7.1f %7.1f %6.2f %6llu %zu of %zu\n",
              static_cast<unsigned long long>(seed), known.c_str(), outcome.live.distance_mm,
              d.distance_mm, d.along_mm, d.out_mm, d.up_mm, d.sigma_mm, d.nees,
              static_cast<unsigned long long>(outcome.gated), outcome.localized, outcome.frames);
  std::fflush(stdout);
}

nlohmann::json asJson(const Drift& drift) {
  return {{"distance_mm", drift.distance_mm}, {"along_mm", drift.along_mm},
          {"out_mm", drift.out_mm},           {"up_mm", drift.up_mm},
          {"sigma_mm", drift.sigma_mm},       {"nees", drift.nees}};
}

Status runAll(const Arguments& arguments) {
  std::printf("%4s %-34s %7s %7s %7s %7s %7s %7s %6s %6s\n", "seed", "known", "live", "final",
              "along", "out", "up", "sigma", "NEES", "gated");
  nlohmann::json all = nlohmann::json::array();
  for (const Knowledge& knowledge : allKnowledge()) {
    nlohmann::json seeds = nlohmann::json::array();
    for (int i = 0; i < arguments.runs; ++i) {
      const std::uint64_t seed = arguments.seed + static_cast<std::uint64_t>(i);
      const Corridor corridor = build(arguments, seed);
      const Outcome outcome = run(arguments, corridor, knowledge, seed);
      print(seed, knowledge.name, outcome);
      seeds.push_back({{"seed", seed},
                       {"live", asJson(outcome.live)},
                       {"final", asJson(outcome.final)},
                       {"gated", outcome.gated},
                       {"localized", outcome.localized},
                       {"frames", outcome.frames}});
    }
    all.push_back({{"known", knowledge.name}, {"length_m", arguments.length_m}, {"seeds", seeds}});
  }
  if (arguments.json.empty()) return success();
  return io::writeTextFile(arguments.json, all.dump(1) + "\n");
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Drift along a wall, with what is known of it and without", "constraints"};
  app.add_option("--length", arguments.length_m, "Of the corridor, metres")
      ->capture_default_str()
      ->check(CLI::Range(3.0, 500.0));
  app.add_option("--spacing", arguments.spacing_m, "Between markers, metres")
      ->capture_default_str()
      ->check(CLI::Range(0.3, 2.0));
  app.add_option("--runs", arguments.runs, "Seeds")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed, "Of the first run")->capture_default_str();
  app.add_option("--sigma", arguments.sigma_px, "Noise of the corners, pixels")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--json", arguments.json, "Write the figures into this file, too");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::exitCodeOf("constraints", bench::runAll(arguments));
}
