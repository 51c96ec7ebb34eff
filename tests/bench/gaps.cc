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
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>

#include "base/clock.h"
#include "base/image_view.h"
#include "io/text/text_file.h"
#include "simulator/simulation.h"
#include "slam/slam.h"
#include "tests/bench/command_line.h"
#include "tests/bench/gap_figure.h"
#include "tests/bench/gap_report.h"
#include "tests/bench/kept_frames.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using slam::Transform;

constexpr double kShortest_s = 1.0;  // a gap

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
  std::string json;    // a file; empty: none
  std::string keep;    // a folder; empty: none
  std::string figure;  // a file; empty: none
};

// One run of a scene.
struct Run {
  std::string scene;
  std::uint64_t seed = 1;
  bool natural = true;  // features between the markers
};

std::optional<Carried> carried(const slam::PoseEstimate& pose, const Transform& truth,
                               const Transform& truth_by_marker) {
  const Eigen::LLT<slam::Matrix6d> factor(pose.covariance);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const slam::Vector6d e = pose.T_w_c.localCoordinates(truth);
  return Carried{e.head<3>().norm(), (pose.T_w_c.p - truth_by_marker.p).norm(),
                 slam::rotationDistance(pose.T_w_c.R, truth_by_marker.R) * 180.0 / std::numbers::pi,
                 std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace()), e.dot(factor.solve(e))};
}

// One run, frame after frame.
class Follower {
 public:
  explicit Follower(GapReport* report) : report_(report) {}

  // T_w_scene: the map's world and the scene's, by the first keyframe and by the last marker.
  void add(double time_s, const slam::FrameResult& result, const Transform& T_scene_c,
           const Transform& T_w_scene, const Transform& T_w_scene_by_marker) {
    ++report_->frames;
    if (result.pose) ++report_->posed;
    const Transform truth = T_w_scene * T_scene_c;
    const auto now =
        result.pose ? carried(*result.pose, truth, T_w_scene_by_marker * T_scene_c) : std::nullopt;
    noteBeyond(time_s, now, result.pose && result.pose->source == slam::PoseSource::kMarkers);
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

  void noteBeyond(double time_s, const std::optional<Carried>& now, bool by_markers) {
    if (!now || !(now->nees > 9.0 * 6.0)) {
      is_beyond_ = false;
      return;
    }
    ++report_->beyond_3_sigma;
    if (!is_beyond_) {
      report_->beyond.push_back({.begin_s = time_s, .by_markers = true});
    }
    is_beyond_ = true;
    Beyond& beyond = report_->beyond.back();
    beyond.end_s = time_s;
    beyond.worst_m = std::max(beyond.worst_m, now->error_m);
    beyond.by_markers = beyond.by_markers && by_markers;
  }

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

  GapReport* report_;
  bool is_beyond_ = false;
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

void addMap(const slam::Map& map, const simulator::Simulation& simulation, GapReport* report) {
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

// track: where each pose is; may be null.
Status runOnce(const Arguments& arguments, const Run& run, GapReport* report, GapTrack* track) {
  simulator::Options asked;
  asked.scene = run.scene;
  asked.seed = run.seed;
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
  options.natural.enabled = run.natural;
  slam::Slam slam(slam::CameraModel(simulation.camera()),
                  *slam::Dictionary::byName(asked.dictionary), options);

  const slam::Calibration& lens = simulation.camera();
  std::vector<std::uint8_t> pixels;
  // Another way of the camera: other frames.
  const bool keeps = !arguments.keep.empty();
  KeptFrames frames(
      simulation, keeps && arguments.there_and_back ? arguments.keep + "/closed" : arguments.keep);
  Follower follower(report);
  std::optional<Transform> T_w_scene;
  std::optional<Eigen::Vector3d> before;  // where the last pose was, in the scene
  int last_marker = -1;
  for (std::int64_t k = 0; k < simulation.frameCount(); ++k) {
    frames.next(k, &pixels);
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
    const Transform by_marker = byMarker(slam.map(), simulation, last_marker).value_or(*T_w_scene);
    follower.add(time_s, result, simulation.poseAt(k), *T_w_scene, by_marker);
    if (track == nullptr || !result.pose) continue;
    const Eigen::Vector3d p = (by_marker.inverse() * result.pose->T_w_c).p;
    const double way_m = track->samples.empty() ? 0.0 : track->samples.back().way_m;
    track->samples.push_back(
        {time_s, p - simulation.poseAt(k).p, way_m + (p - before.value_or(p)).norm()});
    before = p;
  }
  slam.finish();
  addMap(slam.map(), simulation, report);
  return success();
}

// The first seed of the first scene, with features between the markers and with markers alone.
Status drawFigure(const Arguments& arguments) {
  std::vector<GapTrack> tracks;
  for (const bool natural : {true, false}) {
    GapReport nobodys;
    GapTrack& track =
        tracks.emplace_back(GapTrack{natural ? "markers and features" : "markers alone", {}});
    const Status done =
        runOnce(arguments, {arguments.scenes.front(), arguments.seed, natural}, &nobodys, &track);
    if (!done) return done.error();
  }
  double duration_s = 0.0;
  for (const GapTrack& track : tracks) {
    if (!track.samples.empty()) duration_s = std::max(duration_s, track.samples.back().time_s);
  }
  return io::writeTextFile(arguments.figure, gapFigure(tracks, duration_s));
}

tools::ExitCode run(const Arguments& arguments) {
  if (!arguments.figure.empty()) return exitCodeOf("gaps", drawFigure(arguments));
  io::Json all = io::Json::array();
  for (const std::string& scene : arguments.scenes) {
    GapReport report;
    for (int i = 0; i < arguments.runs; ++i) {
      const Run one{scene, arguments.seed + static_cast<std::uint64_t>(i)};
      const Status done = runOnce(arguments, one, &report, nullptr);
      if (!done) {
        std::fprintf(stderr, "gaps: %s\n", done.error().message.c_str());
        return tools::kBadInput;
      }
    }
    const io::Json summary = summaryOf(scene, std::move(report));
    print(summary, arguments.every_gap);
    if (!arguments.json.empty()) all.push_back(summary);
  }
  if (arguments.json.empty()) return tools::kDone;
  return exitCodeOf("gaps", io::writeTextFile(arguments.json, all.dump(1) + "\n"));
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
  app.add_option("--keep", arguments.keep,
                 "Rendered frames are kept in this folder, and taken from there");
  app.add_option("--json", arguments.json, "All of it into this file as well");
  app.add_option("--figure", arguments.figure,
                 "Only draw the first run, and the same with markers alone, into this file (SVG)");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  if (arguments.width > 0 && arguments.height == 0) {
    std::fprintf(stderr, "gaps: --width needs --height\n");
    return tools::kBadInput;
  }
  return bench::run(arguments);
}
