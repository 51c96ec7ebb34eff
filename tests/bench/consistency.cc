// Is the covariance that a pose comes with the one its errors have? Seeded runs over simulated
// corners of known noise: the normalized estimation error squared (NEES), 6 where it is, against
// the truth in the same world, which is the camera of the first keyframe.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>

#include "base/clock.h"
#include "base/image_view.h"
#include "simulator/observed_corners.h"
#include "simulator/simulation.h"
#include "slam/camera/lens_start.h"
#include "slam/camera/undistort_map.h"
#include "slam/slam.h"
#include "slam/testing/lens_scene.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

struct Arguments {
  std::vector<std::string> scenes = {"walls", "ceiling", "revisit", "box",   "spin",
                                     "dolly", "moved",   "doubled", "stress"};
  int runs = 50;
  std::uint64_t seed = 1;
  double sigma_px = 0.1;
  double duration_s = 0.0;  // 0: the scene's
  // What a frame may spend on the map's covariance, units; 0: none is kept.
  double covariance_cost = slam::MapCovarianceOptions{}.cost_per_frame;
  bool images = false;     // rendered and detected, instead of corners of known noise
  bool calibrated = true;  // else the lens is learned from the markers
  // How well the calibration was measured, as a share of the focal length, and says so; 0: exactly.
  double measured_share = 0.0;
};

// A scene of the simulator, or walls with what can go wrong there, as scripts/evaluate has it.
simulator::Options optionsOf(const std::string& scene) {
  simulator::Options options;
  if (scene == "moved") {
    options.moved_marker = {.id = 4, .at_s = 10.0, .offset_m = {0.15, 0.0, 0.05}};
  } else if (scene == "doubled") {
    options.doubled_id = 18;
  } else if (scene == "stress") {  // of corners, the blackout only
    options.rate_hz = 30.0;
    options.noise_sigma = 5.0;
    options.exposure_s = 0.015;
    options.readout_s = 0.02;
    options.blackouts = {{.begin_s = 12.0, .end_s = 13.5}};
  } else {
    options.scene = scene;
  }
  return options;
}

// The lens as somebody has measured it who says how well: all intrinsics in proportion to how
// well any lens is known.
slam::CameraModel measured(const slam::CameraModel& truth, double focal_share, std::uint64_t seed) {
  slam::LensPrior prior;
  const double part = focal_share / prior.focal_share;
  for (double* const share : {&prior.focal_share, &prior.aspect_share, &prior.centre_share,
                              &prior.radial, &prior.higher_radial, &prior.tangential}) {
    *share *= part;
  }
  std::mt19937 rng(static_cast<unsigned>(seed));
  slam::Calibration c = slam::testing::drawnLens(truth, prior, &rng).calibration();
  c.covariance = prior.covariance(truth);
  return slam::CameraModel(c);
}

// NEES of what is told of a quantity of 6 dimensions; empty where the covariance is singular.
std::optional<double> nees(const slam::Transform& truth, const slam::Transform& estimate,
                           const slam::Matrix6d& covariance) {
  const Eigen::LLT<slam::Matrix6d> factor(covariance);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const slam::Vector6d error = estimate.localCoordinates(truth);
  return error.dot(factor.solve(error));
}

struct Sum {
  double total = 0.0;
  int count = 0;
  void add(double value) {
    total += value;
    ++count;
  }
  [[nodiscard]] double mean() const { return count > 0 ? total / count : 0.0; }
};

// Of all runs of a scene.
struct SceneReport {
  std::string scene;
  std::vector<Sum> by_second;  // since the first pose; each frame of each run
  std::vector<double> of_run;  // mean of each, after the first second
  Sum before_loop, after_loop;
  Sum first_second;
  Sum map_markers;    // live, at the end
  Sum final_markers;  // after global optimization
  int singular = 0;
  double cpu_ms = 0.0;  // a frame
};

// Not of one that hangs twice, nor of one that may have moved while nobody looked.
void addMarkers(const slam::Map& map, const simulator::Simulation& simulation,
                const slam::Transform& T_w_scene, Sum* sum) {
  const simulator::Options& options = simulation.options();
  for (const simulator::Marker& truth : simulation.markers()) {
    const slam::MapMarker* const marker = map.findPosed(truth.id);
    if (marker == nullptr || truth.id == options.doubled_id) continue;
    if (options.moved_marker && truth.id == options.moved_marker->id) continue;
    const auto value = nees(T_w_scene * truth.T_w_m, *marker->T_w_m, marker->world_covariance);
    if (value) sum->add(*value);
  }
}

// What the SLAM is given of a frame: corners with noise, or an image.
class Source {
 public:
  // All but the seed must outlive it. given: the lens that the corners are undistorted by.
  Source(const simulator::Simulation& simulation, const slam::CameraModel& camera,
         const slam::CameraModel& given, const Arguments& arguments, std::uint64_t seed)
      : simulation_(simulation),
        camera_(camera),
        given_(given),
        noise_{.sigma_px = arguments.sigma_px, .seed = seed},
        images_(arguments.images) {}

  // Valid until the next one.
  slam::FrameInput frame(std::int64_t k) {
    slam::FrameInput input;
    input.time = {static_cast<std::uint64_t>(k),
                  static_cast<std::int64_t>(1e9 * simulation_.timeOf(k))};
    if (images_) {
      const slam::Calibration& lens = simulation_.camera();
      pixels_.resize(static_cast<std::size_t>(lens.width) * static_cast<std::size_t>(lens.height));
      simulation_.render(k, &workspace_, pixels_.data());
      input.image = ImageView{pixels_.data(), lens.width, lens.height, lens.width};
    } else {
      const auto in_view =
          simulation_.isDark(k) ? std::vector<simulator::Marker>{} : simulation_.visibleMarkers(k);
      detections_ = simulator::observeCorners(camera_, simulation_.poseAt(k), in_view,
                                              static_cast<std::uint64_t>(k), noise_);
      slam::undistortAgain(given_, &detections_);
      input.detections = detections_;
    }
    return input;
  }

 private:
  const simulator::Simulation& simulation_;
  const slam::CameraModel& camera_;
  const slam::CameraModel& given_;
  simulator::ObservationOptions noise_;
  bool images_;
  simulator::Simulation::Workspace workspace_;
  std::vector<std::uint8_t> pixels_;
  std::vector<slam::MarkerDetection> detections_;
};

Status runOnce(const Arguments& arguments, std::uint64_t seed, SceneReport* report) {
  simulator::Options asked = optionsOf(report->scene);
  asked.seed = seed;
  if (arguments.duration_s > 0.0) asked.duration_s = arguments.duration_s;
  const auto made = simulator::Simulation::create(asked, simulator::Ending::kOfTheScene);
  if (!made) return made.error();
  const simulator::Simulation& simulation = **made;
  const slam::CameraModel camera(simulation.camera());
  slam::Options options;
  options.markers.size_m = simulation.markers().front().size_m;
  options.covariance.enabled = arguments.covariance_cost > 0.0;
  options.covariance.cost_per_frame = arguments.covariance_cost;
  if (!arguments.images) options.covariance.repeated_share = 0.0;  // each view's noise is its own
  if (!arguments.calibrated) options.lens.takeForGuess(false);
  slam::CameraModel given = camera;
  if (!arguments.calibrated) {
    given = slam::guessedCamera(camera.width(), camera.height(), std::nullopt, options.lens.start);
  } else if (arguments.measured_share > 0.0) {
    given = measured(camera, arguments.measured_share, seed);
  }
  slam::Slam slam(given, *slam::Dictionary::byName(asked.dictionary), options);
  Source source(simulation, camera, given, arguments, seed);

  std::optional<slam::Transform> T_w_scene;
  double first_pose_s = 0.0;
  Sum of_run;
  std::int64_t cpu_ns = 0;
  for (std::int64_t k = 0; k < simulation.frameCount(); ++k) {
    const double time_s = simulation.timeOf(k);
    const slam::FrameInput input = source.frame(k);
    const std::int64_t before_ns = threadCpuNs();
    const auto result = slam.process(input);
    cpu_ns += threadCpuNs() - before_ns;
    if (!result.pose) continue;
    if (!T_w_scene) {
      const slam::Keyframe& first = slam.map().keyframes().begin()->second;
      T_w_scene =
          first.T_w_c * simulation.poseAt(static_cast<std::int64_t>(first.sequence)).inverse();
      first_pose_s = time_s;
    }
    const auto value =
        nees(*T_w_scene * simulation.poseAt(k), result.pose->T_w_c, result.pose->covariance);
    if (!value) {
      ++report->singular;
      continue;
    }
    const double since_s = time_s - first_pose_s;
    const auto second = static_cast<std::size_t>(since_s);
    if (report->by_second.size() <= second) report->by_second.resize(second + 1);
    report->by_second[second].add(*value);
    if (since_s < 1.0) {
      report->first_second.add(*value);
    } else {
      of_run.add(*value);
      (slam.counters().loop_closures > 0 ? report->after_loop : report->before_loop).add(*value);
    }
  }
  if (!T_w_scene) return success();
  report->of_run.push_back(of_run.mean());
  report->cpu_ms += 1e-6 * static_cast<double>(cpu_ns) /
                    static_cast<double>(simulation.frameCount()) / arguments.runs;
  slam.finish();
  addMarkers(slam.map(), simulation, *T_w_scene, &report->map_markers);
  slam.optimizeGlobally();
  addMarkers(slam.map(), simulation, *T_w_scene, &report->final_markers);
  return success();
}

// How much too small the standard deviations are in the worst second.
double worstSigma(const SceneReport& report) {
  double worst = 0.0;
  for (std::size_t second = 1; second < report.by_second.size(); ++second) {
    worst = std::max(worst, report.by_second[second].mean());
  }
  return std::sqrt(worst / 6.0);
}

void print(SceneReport report) {
  Sum all;
  for (const double mean : report.of_run) all.add(mean);
  std::ranges::sort(report.of_run);
  const double median = report.of_run.empty() ? 0.0 : report.of_run[report.of_run.size() / 2];
  std::printf("%-9s %5zu %8.2f %8.2f %8.2f %8.2f %8.2f %8.2f %8.2f %8.2f %6d %8.4f\n",
              report.scene.c_str(), report.of_run.size(), report.first_second.mean(), all.mean(),
              median, report.before_loop.mean(), report.after_loop.mean(), worstSigma(report),
              report.map_markers.mean(), report.final_markers.mean(), report.singular,
              report.cpu_ms);
  std::fflush(stdout);
}

tools::ExitCode run(const Arguments& arguments) {
  std::printf("%-9s %5s %8s %8s %8s %8s %8s %8s %8s %8s %6s %8s\n", "scene", "runs", "1st s",
              "mean", "median", "before", "after", "worst", "markers", "final", "sing.", "CPU ms");
  for (const std::string& scene : arguments.scenes) {
    SceneReport report;
    report.scene = scene;
    for (int i = 0; i < arguments.runs; ++i) {
      const Status done =
          runOnce(arguments, arguments.seed + static_cast<std::uint64_t>(i), &report);
      if (!done) {
        std::fprintf(stderr, "consistency: %s\n", done.error().message.c_str());
        return tools::kBadInput;
      }
    }
    print(std::move(report));
  }
  return tools::kDone;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Whether the covariances are those of the errors", "consistency"};
  app.add_option("scenes", arguments.scenes, "Scenes of the simulator; moved, doubled, stress")
      ->capture_default_str();
  app.add_option("--runs", arguments.runs)->capture_default_str()->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed, "Of the first run")->capture_default_str();
  app.add_option("--sigma", arguments.sigma_px, "Noise of the corners, pixels")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--covariance-cost", arguments.covariance_cost,
                 "What a frame may spend on the map's covariance, units; 0: none is kept")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  app.add_flag("--images", arguments.images, "Rendered images instead of corners");
  app.add_flag("!--no-calibration", arguments.calibrated, "The lens is learned from the markers");
  app.add_option("--measured", arguments.measured_share,
                 "How well the calibration was measured, as a share of the focal length")
      ->check(CLI::Range(0.0, 0.01));
  app.add_option("--duration", arguments.duration_s, "Seconds; without it the scene's")
      ->check(CLI::PositiveNumber);
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(arguments);
}
