// Gaps between markers, as live: rendered scenes through the whole SLAM, with the lens known. How
// far a carried pose is off, whether its covariance says so (NEES, 6 where it does), how far the
// published pose jumps at the next marker, how many frames have a pose, and what a frame costs.
//
//   gaps dolly corridor office [--runs 50 --width 640 --height 480 --rate 60]
//
// A gap begins after the last frame whose pose is from markers, and counts once it is a second
// long. For the covariance the truth is put where the world is, the first keyframe's camera. "From
// the marker": the error as seen from the last marker before the gap, where the map has it; the
// first keyframe's own error is not in it. A position is beyond 3 sigma where its error is more
// than three times what the covariance says in the direction of that error, of any pose, carried or
// from markers, until the next frame. The scale is of the way since the last pose from markers,
// along it; told at most: what the covariance says of the end's place along it. The first way ends
// at half the time where the camera comes back to where it began.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/clock.h"
#include "base/image_view.h"
#include "io/text/text_file.h"
#include "simulator/simulation.h"
#include "slam/slam.h"
#include "slam/stages.h"
#include "tests/bench/command_line.h"
#include "tests/bench/gap_figure.h"
#include "tests/bench/gap_follower.h"
#include "tests/bench/gap_report.h"
#include "tests/bench/kept_frames.h"
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
  std::string pictures;  // a folder; empty: posters made up from the seed
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

// Thread CPU time of a frame's natural features.
class FeatureClock final : public slam::StageObserver {
 public:
  void begin(slam::Stage stage) override {
    if (stage == slam::Stage::kFeatures) began_ns_ = threadCpuNs();
  }
  void end(slam::Stage stage) override {
    if (stage == slam::Stage::kFeatures) spent_ns_ += threadCpuNs() - began_ns_;
  }
  // Since it was asked last.
  [[nodiscard]] double take_ms() { return 1e-6 * static_cast<double>(std::exchange(spent_ns_, 0)); }

 private:
  std::int64_t began_ns_ = 0;
  std::int64_t spent_ns_ = 0;
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

int mappedOf(const simulator::Simulation& simulation, const slam::Map& map) {
  return static_cast<int>(std::ranges::count_if(
      simulation.markers(),
      [&](const simulator::Marker& marker) { return map.findPosed(marker.id) != nullptr; }));
}

void addMap(const slam::Map& map, const simulator::Simulation& simulation, GapReport* report) {
  double farthest_m = 0.0;
  double error_mm = 0.0;
  const auto& markers = simulation.markers();
  report->markers += static_cast<int>(markers.size());
  report->mapped += mappedOf(simulation, map);
  for (const simulator::Marker& a : markers) {
    const slam::MapMarker* const in_map = map.findPosed(a.id);
    if (in_map == nullptr) continue;
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
  asked.pictures = arguments.pictures;
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
  GapFollower follower(report);
  FeatureClock clock;
  const std::int64_t first_way = firstWay(simulation);
  std::optional<int> mapped_first_way;
  std::optional<Transform> T_w_scene;
  std::optional<Eigen::Vector3d> before;  // where the last pose was, in the scene
  int last_marker = -1;
  for (std::int64_t k = 0; k < simulation.frameCount(); ++k) {
    frames.next(k, &pixels);
    const double time_s = simulation.timeOf(k);
    const std::int64_t before_ns = threadCpuNs();
    const slam::FrameResult result = slam.process(
        {.time = {static_cast<std::uint64_t>(k), static_cast<std::int64_t>(1e9 * time_s)},
         .image = ImageView{pixels.data(), lens.width, lens.height, lens.width}},
        &clock);
    report->cpu_ms.push_back(1e-6 * static_cast<double>(threadCpuNs() - before_ns));
    report->features_ms.push_back(clock.take_ms());
    if (k == first_way) mapped_first_way = mappedOf(simulation, slam.map());
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
  report->mapped_first_way += mapped_first_way.value_or(mappedOf(simulation, slam.map()));
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
      GapReport of_one;
      const Status done = runOnce(arguments, one, &of_one, nullptr);
      if (!done) {
        std::fprintf(stderr, "gaps: %s\n", done.error().message.c_str());
        return tools::kBadInput;
      }
      if (arguments.every_gap) printRun(scene, one.seed, of_one);
      report.add(of_one);
    }
    const io::Json summary = summaryOf(scene, std::move(report));
    print(summary);
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
  app.add_option("--pictures", arguments.pictures,
                 "Photographs of this folder hang there in place of posters");
  app.add_flag("--every-gap", arguments.every_gap, "A line for each, as its run ends");
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
