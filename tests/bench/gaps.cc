// Gaps between markers, as live: rendered scenes through the whole SLAM, with the lens known. How
// far a carried pose is off, whether its covariance says so (NEES, 6 where it does), how far the
// published pose jumps at the next marker, how many frames have a pose, and what a frame costs.
//
//   gaps dolly corridor office [--runs 50 --width 640 --height 480 --rate 60]
//
// A gap begins after the last frame whose pose is from markers, and counts once it is a second
// long. For the covariance the truth is put where the world is, the first keyframe's camera. "From
// the marker": the error as seen from the last marker before the gap, where the map has it; the
// first keyframe's own error is not in it.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>

#include "base/clock.h"
#include "base/image_view.h"
#include "simulator/simulation.h"
#include "slam/slam.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using slam::Transform;

struct Arguments {
  std::vector<std::string> scenes = {"dolly"};
  int runs = 3;
  std::uint64_t seed = 1;
  int width = 0;   // pixels; 0: the scene's
  int height = 0;  // pixels
  double rate_hz = 0.0;
  double duration_s = 0.0;
  bool there_and_back = false;
  bool every_gap = false;
};

constexpr std::array<double, 4> kInto_s = {1.0, 2.0, 5.0, 10.0};
constexpr double kShortest_s = 1.0;

// A pose that was carried, against the truth.
struct Carried {
  double error_m = 0.0;
  double from_marker_m = 0.0;
  double sigma_m = 0.0;  // of the position, the root of the covariance's trace
  double nees = 0.0;
};

struct Gap {
  double begin_s = 0.0;  // of the last pose from markers
  double end_s = 0.0;    // of the last frame before the next one
  double way_m = 0.0;
  std::array<std::optional<Carried>, kInto_s.size()> into;
  std::optional<Carried> last;
  double scale = 0.0;            // of the way since the beginning: estimated over true, less 1
  std::optional<double> jump_m;  // at the next marker
  int frames = 0;
  int posed = 0;
};

struct Report {
  std::vector<Gap> gaps;
  std::vector<double> cpu_ms;  // of every frame
  int frames = 0;              // since the first pose
  int posed = 0;
  int beyond_3_sigma = 0;  // frames
  // Of the live maps at the end: the error of the distance between the two markers that are
  // farthest from each other.
  std::vector<double> distance_errors_mm;
  int mapped = 0;   // markers
  int markers = 0;  // that there are
};

std::optional<Carried> carried(const slam::PoseEstimate& pose, const Transform& truth,
                               const Transform& truth_by_marker) {
  const Eigen::LLT<slam::Matrix6d> factor(pose.covariance);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const slam::Vector6d e = pose.T_w_c.localCoordinates(truth);
  return Carried{e.head<3>().norm(), (pose.T_w_c.p - truth_by_marker.p).norm(),
                 std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace()), e.dot(factor.solve(e))};
}

// One run, frame after frame.
class Follower {
 public:
  explicit Follower(Report* report) : report_(report) {}

  // T_w_scene: the map's world and the scene's, by the first keyframe and by the last marker.
  void add(double time_s, const slam::FrameResult& result, const Transform& T_scene_c,
           const Transform& T_w_scene, const Transform& T_w_scene_by_marker) {
    ++report_->frames;
    if (result.pose) ++report_->posed;
    const Transform truth = T_w_scene * T_scene_c;
    const auto now =
        result.pose ? carried(*result.pose, truth, T_w_scene_by_marker * T_scene_c) : std::nullopt;
    if (now && now->nees > 9.0 * 6.0) ++report_->beyond_3_sigma;
    if (result.pose && result.pose->source == slam::PoseSource::kMarkers) {
      close(result.pose->T_w_c, truth);
      gap_ = Gap{.begin_s = time_s, .end_s = time_s};
      start_ = {result.pose->T_w_c, truth};
      before_ = start_;
    } else if (gap_) {
      extend(time_s, result, truth, now);
    }
  }

 private:
  struct Place {
    Transform estimate;
    Transform truth;
  };

  void extend(double time_s, const slam::FrameResult& result, const Transform& truth,
              const std::optional<Carried>& now) {
    gap_->way_m += (truth.p - before_.truth.p).norm();
    gap_->end_s = time_s;
    ++gap_->frames;
    gap_->last = now;
    before_.truth = truth;
    if (!result.pose) return;
    ++gap_->posed;
    before_.estimate = result.pose->T_w_c;
    const Eigen::Vector3d true_way = truth.p - start_.truth.p;
    const Eigen::Vector3d way = result.pose->T_w_c.p - start_.estimate.p;
    if (true_way.norm() > 0.3) gap_->scale = way.dot(true_way) / true_way.squaredNorm() - 1.0;
    for (std::size_t i = 0; i < kInto_s.size(); ++i) {
      if (!gap_->into[i] && time_s - gap_->begin_s >= kInto_s[i]) gap_->into[i] = now;
    }
  }

  void close(const Transform& estimate, const Transform& truth) {
    if (!gap_ || gap_->end_s - gap_->begin_s < kShortest_s) return;
    if (gap_->last) {
      // What the camera itself did meanwhile is no jump.
      const Eigen::Vector3d moved = truth.p - before_.truth.p;
      gap_->jump_m = (estimate.p - before_.estimate.p - moved).norm();
    }
    report_->gaps.push_back(*gap_);
  }

  Report* report_;
  std::optional<Gap> gap_;
  Place start_;   // the last pose from markers
  Place before_;  // the frame before
};

// The map's world and the scene's, by where both have a marker.
std::optional<Transform> byMarker(const slam::Map& map, const simulator::Simulation& simulation,
                                  int id) {
  const slam::MapMarker* const marker = map.findPosed(id);
  for (const simulator::Marker& truth : simulation.markers()) {
    if (marker != nullptr && truth.id == id) return *marker->T_w_m * truth.T_w_m.inverse();
  }
  return std::nullopt;
}

void addMap(const slam::Map& map, const simulator::Simulation& simulation, Report* report) {
  double farthest_m = 0.0;
  double error_mm = 0.0;
  const auto& markers = simulation.markers();
  report->markers += static_cast<int>(markers.size());
  for (const simulator::Marker& a : markers) {
    const slam::MapMarker* const in_map = map.findPosed(a.id);
    if (in_map == nullptr) continue;
    ++report->mapped;
    for (const simulator::Marker& b : markers) {
      const slam::MapMarker* const other = map.findPosed(b.id);
      const double distance_m = (a.T_w_m.p - b.T_w_m.p).norm();
      if (other == nullptr || distance_m <= farthest_m) continue;
      farthest_m = distance_m;
      error_mm = 1e3 * ((in_map->T_w_m->p - other->T_w_m->p).norm() - distance_m);
    }
  }
  if (farthest_m > 0.0) report->distance_errors_mm.push_back(error_mm);
}

Status runOnce(const Arguments& arguments, const std::string& scene, std::uint64_t seed,
               Report* report) {
  simulator::Options asked;
  asked.scene = scene;
  asked.seed = seed;
  if (arguments.width > 0) asked.size = simulator::ImageSize{arguments.width, arguments.height};
  if (arguments.rate_hz > 0.0) asked.rate_hz = arguments.rate_hz;
  if (arguments.duration_s > 0.0) asked.duration_s = arguments.duration_s;
  const auto made = simulator::Simulation::create(asked, arguments.there_and_back
                                                             ? simulator::Ending::kClosedLoop
                                                             : simulator::Ending::kOfTheScene);
  if (!made) return made.error();
  const simulator::Simulation& simulation = **made;
  slam::Options options;
  options.markers.size_m = simulation.markers().front().size_m;
  slam::Slam slam(slam::CameraModel(simulation.camera()),
                  *slam::Dictionary::byName(asked.dictionary), options);

  const slam::Calibration& lens = simulation.camera();
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(lens.width) *
                                   static_cast<std::size_t>(lens.height));
  simulator::Simulation::Workspace workspace;
  Follower follower(report);
  std::optional<Transform> T_w_scene;
  int last_marker = -1;
  for (std::int64_t k = 0; k < simulation.frameCount(); ++k) {
    simulation.render(k, &workspace, pixels.data());
    const double time_s = simulation.timeOf(k);
    const std::int64_t before_ns = threadCpuNs();
    const slam::FrameResult result = slam.process(
        {.time = {static_cast<std::uint64_t>(k), static_cast<std::int64_t>(1e9 * time_s)},
         .image = ImageView{pixels.data(), lens.width, lens.height, lens.width}});
    report->cpu_ms.push_back(1e-6 * static_cast<double>(threadCpuNs() - before_ns));
    if (!T_w_scene && result.pose && !slam.map().keyframes().empty()) {
      const slam::Keyframe& first = slam.map().keyframes().begin()->second;
      T_w_scene =
          first.T_w_c * simulation.poseAt(static_cast<std::int64_t>(first.sequence)).inverse();
    }
    if (!T_w_scene) continue;
    const bool by_markers = result.pose && result.pose->source == slam::PoseSource::kMarkers;
    for (const slam::MarkerDetection& detection : result.detections) {
      if (!by_markers) break;
      if (slam.map().findPosed(detection.id) != nullptr) last_marker = detection.id;
    }
    follower.add(time_s, result, simulation.poseAt(k), *T_w_scene,
                 byMarker(slam.map(), simulation, last_marker).value_or(*T_w_scene));
  }
  slam.finish();
  addMap(slam.map(), simulation, report);
  return success();
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

double rms(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return values.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(values.size()));
}

double largest(const std::vector<double>& values) {
  return values.empty() ? 0.0 : *std::ranges::max_element(values);
}

double largestSize(std::vector<double> values) {
  for (double& value : values) value = std::abs(value);
  return largest(values);
}

void printInto(const Report& report) {
  for (std::size_t i = 0; i < kInto_s.size(); ++i) {
    std::vector<double> errors, from_marker, sigmas, nees;
    for (const Gap& gap : report.gaps) {
      if (!gap.into[i]) continue;
      errors.push_back(1e3 * gap.into[i]->error_m);
      from_marker.push_back(1e3 * gap.into[i]->from_marker_m);
      sigmas.push_back(1e3 * gap.into[i]->sigma_m);
      nees.push_back(gap.into[i]->nees);
    }
    if (errors.empty()) continue;
    // The sum over n gaps of a quantity of 6 dimensions has 6n degrees of freedom.
    const double band = 1.96 * std::sqrt(12.0 / static_cast<double>(nees.size()));
    std::printf(
        "  %4.0f s into %3zu gaps: error %6.1f mm rms, worst %6.1f, sigma %6.1f; from the marker "
        "%.1f; NEES %5.2f (95 %% of 6: %.2f to %.2f)\n",
        kInto_s[i], errors.size(), rms(errors), largest(errors), rms(sigmas), rms(from_marker),
        mean(nees), 6.0 - band, 6.0 + band);
  }
}

void printEnds(const Report& report) {
  std::vector<double> errors, from_marker, shares, jumps, scales, ways;
  int lost = 0;
  for (const Gap& gap : report.gaps) {
    ways.push_back(gap.way_m);
    if (!gap.last) {
      ++lost;
      continue;
    }
    errors.push_back(1e3 * gap.last->error_m);
    from_marker.push_back(1e3 * gap.last->from_marker_m);
    shares.push_back(1e2 * gap.last->from_marker_m / std::max(gap.way_m, 1e-9));
    scales.push_back(1e2 * gap.scale);
    if (gap.jump_m) jumps.push_back(1e3 * *gap.jump_m);
  }
  std::printf(
      "  ends: error %.1f mm rms, worst %.1f; from the marker %.1f, worst %.1f, of %.2f m (%.2f %% "
      "rms, worst %.2f), scale %.2f %% rms; jump %.1f mm rms, worst %.1f; lost before the end: "
      "%d of %zu\n",
      rms(errors), largest(errors), rms(from_marker), largest(from_marker), mean(ways), rms(shares),
      largest(shares), rms(scales), rms(jumps), largest(jumps), lost, report.gaps.size());
}

void print(const std::string& scene, Report report, bool every_gap) {
  std::ranges::sort(report.cpu_ms);
  const std::size_t frames = report.cpu_ms.size();
  std::printf(
      "%s: %zu frames, a pose in %.2f %% since the first one, NEES above 54 in %.2f %%; %.2f "
      "ms a frame, p99 %.2f, worst %.2f\n",
      scene.c_str(), frames, 1e2 * report.posed / std::max(1, report.frames),
      1e2 * report.beyond_3_sigma / std::max(1, report.frames), mean(report.cpu_ms),
      report.cpu_ms[frames * 99 / 100], report.cpu_ms.back());
  printInto(report);
  if (!report.gaps.empty()) printEnds(report);
  std::printf(
      "  live maps: %d of %d markers, distance of the farthest two off by %.1f mm rms, worst "
      "%.1f\n",
      report.mapped, report.markers, rms(report.distance_errors_mm),
      largestSize(report.distance_errors_mm));
  for (const Gap& gap : report.gaps) {
    if (!every_gap) break;
    std::printf("    %.2f to %.2f s, %.2f m: %d of %d frames", gap.begin_s, gap.end_s, gap.way_m,
                gap.posed, gap.frames);
    if (gap.last) {
      std::printf(", error %.1f mm, from the marker %.1f, sigma %.1f, NEES %.1f, scale %.2f %%",
                  1e3 * gap.last->error_m, 1e3 * gap.last->from_marker_m, 1e3 * gap.last->sigma_m,
                  gap.last->nees, 1e2 * gap.scale);
    }
    if (gap.jump_m) std::printf(", jump %.1f mm", 1e3 * *gap.jump_m);
    std::printf("\n");
  }
  std::fflush(stdout);
}

tools::ExitCode run(const Arguments& arguments) {
  for (const std::string& scene : arguments.scenes) {
    Report report;
    for (int i = 0; i < arguments.runs; ++i) {
      const Status done =
          runOnce(arguments, scene, arguments.seed + static_cast<std::uint64_t>(i), &report);
      if (!done) {
        std::fprintf(stderr, "gaps: %s\n", done.error().message.c_str());
        return tools::kBadInput;
      }
    }
    print(scene, std::move(report), arguments.every_gap);
  }
  return tools::kDone;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Poses in the gaps between markers", "gaps"};
  app.add_option("scenes", arguments.scenes, "Scenes of the simulator")->capture_default_str();
  app.add_option("--runs", arguments.runs, "Seeds of each")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed, "Of the first run")->capture_default_str();
  CLI::Option* width = app.add_option("--width", arguments.width, "Pixels; without it the scene's")
                           ->check(CLI::PositiveNumber);
  app.add_option("--height", arguments.height, "Pixels")->check(CLI::PositiveNumber)->needs(width);
  app.add_option("--rate", arguments.rate_hz, "Hz; without it the scene's")
      ->check(CLI::PositiveNumber);
  app.add_option("--duration", arguments.duration_s, "Seconds; without it the scene's")
      ->check(CLI::PositiveNumber);
  app.add_flag("--there-and-back", arguments.there_and_back,
               "End where it began, in the scene's own time for both ways");
  app.add_flag("--every-gap", arguments.every_gap, "A line for each");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  if (arguments.width > 0 && arguments.height == 0) {
    std::fprintf(stderr, "gaps: --width needs --height\n");
    return tools::kBadInput;
  }
  return bench::run(arguments);
}
