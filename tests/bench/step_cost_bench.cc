// What the steps of long work cost, and what they are priced at. The budgets of slam/ are counted
// in units that the code prices its steps in; here each kind of step is made many times, and the
// thread CPU time it takes is set beside the units it spends. Where a price is made of several
// constants, rows of few and of many of a kind tell them apart.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/clock.h"
#include "base/task.h"
#include "slam/loop_closure/loop_closer.h"
#include "slam/loop_closure/pose_graph.h"
#include "slam/optimization/bundle_adjuster.h"
#include "slam/optimization/normal_equations.h"
#include "slam/optimization/schur_complement.h"
#include "slam/optimization/subproblem.h"
#include "slam/pieces/joined_map.h"
#include "slam/testing/scene.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using slam::BundleProblem;
using slam::Matrix6d;
using slam::Transform;
using slam::Vector6d;

constexpr double kSize_m = 0.12;

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// A table that grows by a row a kind of step.
class StepTable {
 public:
  explicit StepTable(int repetitions) : repetitions_(repetitions) {
    std::printf("%-66s %10s %10s %7s\n", "a step", "price", "took us", "ratio");
  }

  // begin(budget) gives a task of so many steps; prepare() is called before each, and not measured.
  template <typename Prepare, typename Begin>
  void add(const std::string& name, double steps, const Prepare& prepare, const Begin& begin) {
    constexpr double kPlenty = 1e9;  // units; what is left of it is exact to 1e-7
    double price = 0.0;
    std::vector<double> took_us;
    for (int i = 0; i < repetitions_; ++i) {
      prepare();
      Budget budget;
      budget.grant(kPlenty);
      auto task = begin(&budget);
      const std::int64_t before_ns = threadCpuNs();
      task.begin();
      took_us.push_back(1e-3 * static_cast<double>(threadCpuNs() - before_ns) / steps);
      price = (kPlenty - budget.left()) / steps;
      if (!task.done() || !(price > 0.0)) {
        std::fprintf(stderr, "step_cost_bench: '%s' is not priced\n", name.c_str());
        complete_ = false;
        return;
      }
    }
    std::ranges::nth_element(took_us, took_us.begin() + repetitions_ / 2);
    const double median_us = took_us[at(repetitions_ / 2)];
    std::printf("%-66s %10.3f %10.3f %7.2f\n", name.c_str(), price, median_us, median_us / price);
  }
  template <typename Begin>
  void add(const std::string& name, double steps, const Begin& begin) {
    add(
        name, steps, [] {}, begin);
  }
  void section(const char* title) { std::printf("%s\n", title); }

  // Whether every step has a price.
  [[nodiscard]] bool complete() const { return complete_; }

 private:
  int repetitions_;
  bool complete_ = true;
};

// Cameras that all see the whole of a wall of markers.
struct Views {
  Views(int camera_count, int rows, int columns) {
    const double spacing_m = 1.6 / std::max(rows, columns);
    const auto wall = slam::testing::markerWall(rows, columns, spacing_m, &rng);
    for (const auto& marker : wall) {
      problem.markers.push_back({slam::testing::disturbed(marker.T_w_m, 0.005, &rng), false});
      problem.marker_sizes_m.push_back(kSize_m);
    }
    std::uniform_real_distribution<double> u(-0.3, 0.3);
    for (int c = 0; c < camera_count; ++c) {
      const Transform T_w_c = slam::testing::lookAt({u(rng), u(rng), u(rng)}, {0.0, 3.0, 0.0});
      problem.cameras.push_back({T_w_c, c == 0});
      for (const auto& marker : wall) {
        const auto seen =
            slam::testing::observe(camera, T_w_c, marker.id, marker.T_w_m, kSize_m, 0.1, &rng);
        if (!seen) continue;
        detections.push_back(*seen);
        problem.observations.push_back({c, marker.id, &detections.back()});
      }
    }
  }
  Views(const Views&) = delete;
  Views& operator=(const Views&) = delete;
  ~Views() = default;

  // Lens and readout time are unknowns, too.
  void freeGlobals() {
    const slam::IntrinsicVector expected = camera.intrinsics();
    problem.lens = {camera, camera, expected, 1e-6 * slam::IntrinsicMatrix::Identity()};
    problem.shutter = BundleProblem::Shutter{};
    BundleProblem::Shutter& shutter = *problem.shutter;
    shutter.motion.resize(problem.observations.size());
    for (auto& motion : shutter.motion) motion.fill(Eigen::Vector2d(0.1, 0.2));
  }
  [[nodiscard]] double observations() const {
    return static_cast<double>(problem.observations.size());
  }

  std::mt19937 rng{7};
  slam::CameraModel camera{slam::testing::testCalibration()};
  std::deque<slam::MarkerDetection> detections;
  BundleProblem problem;
};

// --- Normal equations --------------------------------------------------------------------------

void linearize(const std::string& name, const Views& views, StepTable* table) {
  const auto whitened =
      runToCompletion([&](Budget* b) { return slam::whitenViews(views.problem, b); });
  slam::NormalEquations equations;
  table->add(name, views.observations(), [&](Budget* b) {
    return slam::linearize(views.problem, whitened, 2.45, &equations, b);
  });
}

void measureNormalEquations(StepTable* table) {
  table->section("optimization/normal_equations, bundle_adjuster");
  Views views(100, 5, 8);
  const BundleProblem& problem = views.problem;
  const double observations = views.observations();
  table->add("corners of an observation whitened", observations,
             [&](Budget* b) { return slam::whitenViews(problem, b); });
  const auto whitened = runToCompletion([&](Budget* b) { return slam::whitenViews(problem, b); });
  std::vector<double> squared;
  table->add("residuals of an observation", observations,
             [&](Budget* b) { return slam::cornerErrors(problem, whitened, &squared, b); });
  double cost = 0.0;
  table->add("robust cost of an observation", observations,
             [&](Budget* b) { return slam::robustCost(problem, whitened, 2.45, &cost, b); });
  linearize("an observation linearized", views, table);
  const std::vector<Vector6d> step(problem.cameras.size(), Vector6d::Constant(1e-3));
  std::vector<BundleProblem::Pose> moved = problem.cameras;
  table->add("a pose moved", static_cast<double>(moved.size() - 1),
             [&](Budget* b) { return slam::movePoses(problem.cameras, step, &moved, b); });
  views.freeGlobals();
  linearize("an observation linearized, lens and shutter unknown", views, table);
}

// --- Block system ------------------------------------------------------------------------------

// Poses that share a block with so many before them.
std::vector<std::vector<int>> band(int poses, int width) {
  std::vector<std::vector<int>> neighbours(at(poses));
  for (int i = 0; i < poses; ++i) {
    for (int j = std::max(i - width, 0); j < i; ++j) neighbours[at(i)].push_back(j);
  }
  return neighbours;
}

void measureBlockSystem(int poses, int width, StepTable* table) {
  const auto neighbours = band(poses, width);
  const std::string kind =
      std::to_string(poses) + " that meet the " + std::to_string(width) + " before them";
  slam::BlockSystem system;
  table->add("a pose of " + kind + ", arranged", poses,
             [&](Budget* b) { return system.arrange(neighbours, false, b); });
  table->add("the same cleared", poses, [&](Budget* b) { return system.clear(b); });
  const auto fill = [&] {
    runToCompletion([&](Budget* b) { return system.clear(b); });
    for (int i = 0; i < poses; ++i) {
      system.diagonal(system.positionOf(i)) = 100.0 * width * Matrix6d::Identity();
      system.right(system.positionOf(i)).setOnes();
      for (const int j : neighbours[at(i)]) {
        const auto [column, row] = std::minmax({system.positionOf(i), system.positionOf(j)});
        system.block(system.place(row, column)).setOnes();
      }
    }
  };
  table->add("the same solved", poses, fill, [&](Budget* b) { return system.solve(b); });
  const auto other = [&] {
    for (int i = 0; i < poses; ++i) system.right(i).setOnes();
  };
  table->add("the same for other right sides", poses, other,
             [&](Budget* b) { return system.solveAgain(b); });
}

// --- Schur complement --------------------------------------------------------------------------

void measureSchurComplement(int rows, int columns, bool globals, StepTable* table) {
  constexpr int kCameras = 400;
  Views views(kCameras, rows, columns);
  if (globals) views.freeGlobals();
  const BundleProblem& problem = views.problem;
  const auto whitened = runToCompletion([&](Budget* b) { return slam::whitenViews(problem, b); });
  slam::NormalEquations equations;
  runToCompletion(
      [&](Budget* b) { return slam::linearize(problem, whitened, 2.45, &equations, b); });
  slam::SchurComplement schur;
  const std::string kind = "a pose that sees " + std::to_string(rows * columns) +
                           (globals ? ", lens and shutter unknown," : "");
  table->add(kind + " arranged", kCameras, [&](Budget* b) { return schur.arrange(problem, b); });
  slam::BundleStep step;
  table->add(kind + " eliminated, and solved", kCameras,
             [&](Budget* b) { return schur.solve(problem, equations, 1e-5, &step, b); });
}

// --- Parts of the map, loops ---------------------------------------------------------------------

struct Room {
  static constexpr double kLoop_rad = 2.0 * std::numbers::pi;

  explicit Room(int keyframes) {
    options.size_m = 0.25;
    markers = slam::testing::roomMarkers(24, 2.5, &rng);
    const auto views = slam::testing::roomViews(0.0, 0.9 * kLoop_rad, keyframes);
    map = slam::testing::trueMap(camera, views, markers, options.size_m, 0.1, &rng);
    for (const auto& [id, keyframe] : map.keyframes()) {
      views_of_markers += static_cast<double>(keyframe.detections.size());
    }
  }

  std::mt19937 rng{8};
  slam::CameraModel camera{slam::testing::testCalibration()};
  slam::MarkerOptions options;
  std::vector<slam::testing::SyntheticMarker> markers;
  slam::Map map;
  double views_of_markers = 0.0;
};

void measureSubproblem(StepTable* table) {
  table->section("optimization/subproblem");
  const Room room(600);
  table->add("a marker's view cut out of the map", room.views_of_markers, [&](Budget* b) {
    return slam::buildSubproblem(room.map, slam::wholeMap(room.map), room.options, b);
  });
}

void measurePoseGraph(StepTable* table) {
  table->section("loop_closure/pose_graph");
  constexpr int kEdges = 10'000;
  slam::PoseGraph graph;
  const Transform T_a_b{slam::expSo3({0.1, -0.2, 0.3}), {0.3, 0.1, -0.2}};
  graph.poses = {Transform{}, T_a_b, T_a_b * T_a_b.retract(Vector6d::Constant(0.01))};
  graph.edges.assign(kEdges, {0, 1, T_a_b});
  slam::PoseGraphOptions options;
  options.max_iterations = 0;  // its cost is all
  slam::PoseGraph work;
  const auto begin = [&](Budget* b) { return slam::optimizePoseGraph(&work, options, b); };
  table->add(
      "the error of an edge", kEdges, [&] { work = graph; }, begin);
  graph.edges.assign(kEdges, {1, 2, T_a_b});
  options.max_iterations = 1;
  table->add(
      "an edge linearized, its error before and after", kEdges, [&] { work = graph; }, begin);
}

void measureCovisibility(int cameras, int rows, int columns, StepTable* table) {
  const Views views(cameras, rows, columns);
  const double pairs = 0.5 * cameras * (cameras - 1.0);
  table->add("two cameras that share " + std::to_string(rows * columns) + " connected", pairs,
             [&](Budget* b) { return slam::covisibilityGraph(views.problem, 4, b); });
}

void measureLoopCloser(StepTable* table) {
  table->section("loop_closure/loop_closer");
  measureCovisibility(400, 1, 1, table);
  measureCovisibility(400, 5, 8, table);
  const Views views(400, 5, 8);
  std::vector<Transform> after;
  std::vector<int> all;
  for (const BundleProblem::Pose& pose : views.problem.cameras) {
    all.push_back(static_cast<int>(all.size()));
    after.push_back(pose.T.retract(Vector6d::Constant(1e-3)));
  }
  const std::vector<std::vector<int>> by_marker(views.problem.markers.size(), all);
  std::vector<BundleProblem::Pose> markers;
  table->add(
      "a marker moved by a camera that sees it", static_cast<double>(all.size() * by_marker.size()),
      [&] { markers = views.problem.markers; },
      [&](Budget* b) {
        return slam::correctMarkers(by_marker, views.problem.cameras, after, &markers, b);
      });
}

// --- Pieces --------------------------------------------------------------------------------------

void measureJoint(StepTable* table) {
  table->section("pieces/joined_map");
  const Room room(600);
  slam::Map other;
  constexpr int kOthers = 100;  // beyond the ids of the room
  for (const auto& [id, marker] : room.map.markers()) {
    slam::MapMarker theirs = marker;
    theirs.id += kOthers;
    (void)other.putMarker(theirs);
  }
  for (const auto& [id, keyframe] : room.map.keyframes()) {
    slam::Keyframe theirs = keyframe;
    theirs.detections.change([&](auto* detections) {
      for (slam::MarkerDetection& detection : *detections) detection.id += kOthers;
    });
    (void)other.addKeyframe(std::move(theirs));
  }
  const slam::PieceJoint joint;
  table->add("a keyframe of two pieces put into the map of both",
             static_cast<double>(room.map.keyframes().size() + other.keyframes().size()),
             [&](Budget* b) { return slam::joinMaps(room.map, other, joint, b); });
  // Hardly anything but markers.
  slam::Map here;
  slam::Map there;
  constexpr int kMarkers = 2000;
  slam::MapMarker marker = room.map.markers().begin()->second;
  for (int i = 0; i < kMarkers; ++i) {
    marker.id = i;
    (void)(i % 2 == 0 ? here : there).putMarker(marker);
  }
  table->add("a marker of two pieces put into the map of both", kMarkers,
             [&](Budget* b) { return slam::joinMaps(here, there, joint, b); });
}

// --- All of it -----------------------------------------------------------------------------------

void measureWholes(StepTable* table) {
  table->section("all of it");
  const Room room(120);
  const slam::KeyframeId last = room.map.keyframes().rbegin()->first;
  table->add("an optimization around a keyframe", 1.0, [&](Budget* b) -> Task<slam::BundleSummary> {
    slam::Subproblem part =
        co_await slam::buildSubproblem(room.map, slam::localMap(room.map, last), room.options, b);
    slam::BundleAdjuster adjuster(std::move(part.problem), {});
    co_return co_await adjuster.run(b);
  });
  // The frame that closes the loop: where it is, by the map's end and by its beginning.
  const Transform T_w_c = slam::testing::roomView(0.93 * Room::kLoop_rad);
  std::mt19937 rng(9);
  slam::LoopFrame loop;
  loop.frame.detections =
      slam::testing::observeAll(room.camera, T_w_c, room.markers, room.options.size_m, 0.1, &rng);
  loop.frame.T_w_c = T_w_c.retract(Vector6d::Constant(0.02));
  loop.loop_markers = {23};
  loop.expected = {T_w_c};
  loop.reference = last;
  const slam::LoopOptions options;
  char name[96];
  std::snprintf(name, sizeof(name), "a loop closed, by view of the map (cost_per_view %g)",
                options.cost_per_view);
  table->add(name, room.views_of_markers,
             [&](Budget* b) { return slam::closeLoop(room.map, loop, room.options, options, b); });
}

bool run(int repetitions) {
  StepTable table(repetitions);
  measureNormalEquations(&table);
  table.section("optimization/block_system");
  measureBlockSystem(1000, 1, &table);
  measureBlockSystem(120, 20, &table);
  table.section("optimization/schur_complement");
  measureSchurComplement(1, 1, false, &table);
  measureSchurComplement(2, 2, false, &table);
  measureSchurComplement(5, 8, false, &table);
  measureSchurComplement(5, 8, true, &table);
  measureSubproblem(&table);
  measurePoseGraph(&table);
  measureLoopCloser(&table);
  measureJoint(&table);
  measureWholes(&table);
  return table.complete();
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  int repetitions = 51;
  CLI::App app{"What the steps of long work cost, beside what they are priced at",
               "step_cost_bench"};
  app.add_option("--repetitions", repetitions, "Of each measurement; its median is told")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(repetitions) ? tools::kDone : tools::kInternalError;
}
