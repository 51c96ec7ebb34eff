// The SLAM over millions of frames of simulated corners, or through a map of thousands of markers:
// does its time per frame stay flat, its memory bounded, its map sound?
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "base/clock.h"
#include "base/freed_memory.h"
#include "io/maps/map_file.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "simulator/observed_corners.h"
#include "slam/geometry/align_points.h"
#include "slam/slam.h"
#include "tests/bench/command_line.h"
#include "tests/bench/walk.h"
#include "tools/evaluation/evaluation.h"
#include "tools/exit_code.h"
#include "tools/stage_timer.h"

namespace waymark::bench {
namespace {

struct Arguments {
  WalkOptions walk;
  std::int64_t frames = 1'000'000;
  std::int64_t report_every = 100'000;
  double sigma_px = 0.1;
  std::string json_file;
};

double residentMegabytes() {
  std::ifstream statm("/proc/self/statm");
  double total = 0.0;
  double resident = 0.0;  // pages
  statm >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1024.0 * 1024.0);
}

// What happened since the last report.
struct Stretch {
  std::vector<double> cpu_ms;
  std::vector<Eigen::Vector3d> truth;
  std::vector<Eigen::Vector3d> estimate;
};

std::vector<io::MarkerCorners> layoutOf(const Walk& walk) {
  std::vector<io::MarkerCorners> layout;
  for (const simulator::Marker& marker : walk.markers) {
    io::MarkerCorners truth{marker.id, marker.size_m, slam::markerCorners(marker.size_m)};
    for (Eigen::Vector3d& corner : truth.corners) corner = marker.T_w_m * corner;
    layout.push_back(truth);
  }
  return layout;
}

// Positions of a stretch against the truth, aligned by themselves; millimetres.
std::optional<double> ate_mm(const Stretch& stretch) {
  if (stretch.estimate.empty()) return std::nullopt;
  const slam::Transform T = slam::alignPoints(stretch.estimate, stretch.truth);
  double sum_m = 0.0;
  for (std::size_t i = 0; i < stretch.truth.size(); ++i) {
    sum_m += (T * stretch.estimate[i] - stretch.truth[i]).norm();
  }
  return 1000.0 * sum_m / static_cast<double>(stretch.truth.size());
}

// What is told of a stretch.
struct Report {
  std::int64_t frames = 0;  // since the start
  std::size_t markers = 0;
  std::size_t keyframes = 0;
  double localized_percent = 0.0;
  tools::TimeSummary cpu_ms;
  double resident_mb = 0.0;
  std::optional<double> ate_mm;
  std::optional<double> ace_mm;
};

void printHead() {
  std::printf("%9s %8s %9s %9s %9s %9s %9s %9s %9s %9s\n", "frames", "markers", "keyframes",
              "localized", "mean ms", "p99 ms", "max ms", "MB", "ATE mm", "ACE mm");
}

Report reportOf(std::int64_t frames, const slam::Slam& slam,
                std::span<const io::MarkerCorners> layout, Stretch stretch) {
  const auto count = static_cast<double>(stretch.cpu_ms.size());
  const std::vector<io::MarkerCorners> map = io::posedMarkerCorners(slam.map());
  const auto errors = tools::compareMaps(layout, map);
  Report report;
  report.frames = frames;
  report.markers = map.size();
  report.keyframes = slam.map().keyframes().size();
  report.localized_percent = 100.0 * static_cast<double>(stretch.estimate.size()) / count;
  report.cpu_ms = tools::summarize(std::move(stretch.cpu_ms));
  report.resident_mb = residentMegabytes();
  report.ate_mm = ate_mm(stretch);
  if (errors) report.ace_mm = 1000.0 * errors->ace_m.mean;
  return report;
}

void print(const Report& r) {
  const auto text = [](const std::optional<double>& mm) { return mm ? io::fixed(*mm, 3) : "-"; };
  std::printf("%9lld %8zu %9zu %8.2f%% %9.4f %9.4f %9.4f %9.1f %9s %9s\n",
              static_cast<long long>(r.frames), r.markers, r.keyframes, r.localized_percent,
              r.cpu_ms.mean, r.cpu_ms.p99, r.cpu_ms.max, r.resident_mb, text(r.ate_mm).c_str(),
              text(r.ace_mm).c_str());
  std::fflush(stdout);
}

std::string jsonOf(std::span<const Report> reports) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const Report& r : reports) {
    const auto number = [](const std::optional<double>& mm) {
      return mm ? nlohmann::ordered_json(*mm) : nlohmann::ordered_json();
    };
    all.push_back({{"frames", r.frames},
                   {"markers", r.markers},
                   {"keyframes", r.keyframes},
                   {"localized_percent", r.localized_percent},
                   {"mean_ms", r.cpu_ms.mean},
                   {"p99_ms", r.cpu_ms.p99},
                   {"max_ms", r.cpu_ms.max},
                   {"resident_mb", r.resident_mb},
                   {"ate_mm", number(r.ate_mm)},
                   {"ace_mm", number(r.ace_mm)}});
  }
  return all.dump(1) + "\n";
}

tools::ExitCode run(const Arguments& arguments) {
  const Result<Walk> planned = planWalk(arguments.walk);
  if (!planned) {
    std::fprintf(stderr, "long_run: %s\n", planned.error().message.c_str());
    return tools::kBadInput;
  }
  keepFreedMemory();  // as the daemon does
  const Walk& walk = *planned;
  const slam::CameraModel camera(walk.camera);
  const std::vector<io::MarkerCorners> layout = layoutOf(walk);
  slam::Options options;
  options.markers.size_m = walk.marker_size_m;
  // The corners come with their ids; the dictionary is only a name here.
  slam::Slam slam(camera, *slam::Dictionary::byName("4X4_1000"), options);
  const simulator::ObservationOptions noise{.sigma_px = arguments.sigma_px,
                                            .seed = arguments.walk.seed};
  std::printf("%s, seed %llu: %zu markers, corners of %.2f px, %zu frames a round\n",
              arguments.walk.scene.c_str(), static_cast<unsigned long long>(arguments.walk.seed),
              walk.markers.size(), arguments.sigma_px, walk.frames.size());
  printHead();

  Stretch stretch;
  std::vector<Report> reports;
  for (std::int64_t k = 0; k < arguments.frames; ++k) {
    const Walk::Frame& frame = walk.frames[static_cast<std::size_t>(k) % walk.frames.size()];
    const auto sequence = static_cast<std::uint64_t>(k);
    const auto time_ns = static_cast<std::int64_t>(1e9 * static_cast<double>(k) / walk.rate_hz);
    const std::vector<slam::MarkerDetection> detections =
        simulator::observeCorners(camera, frame.T_w_c, frame.in_view, sequence, noise);
    const std::int64_t before_ns = threadCpuNs();
    const slam::FrameResult result =
        slam.process({.time = {sequence, time_ns}, .detections = detections});
    stretch.cpu_ms.push_back(1e-6 * static_cast<double>(threadCpuNs() - before_ns));
    if (result.pose) {
      stretch.truth.push_back(frame.T_w_c.p);
      stretch.estimate.push_back(result.pose->T_w_c.p);
    }
    if ((k + 1) % arguments.report_every == 0 || k + 1 == arguments.frames) {
      reports.push_back(reportOf(k + 1, slam, layout, std::move(stretch)));
      print(reports.back());
      stretch = {};
    }
  }
  if (!arguments.json_file.empty()) {
    const Status written = io::writeTextFile(arguments.json_file, jsonOf(reports));
    if (!written) {
      std::fprintf(stderr, "long_run: %s\n", written.error().message.c_str());
      return tools::kBadInput;
    }
  }
  return slam.counters().localized > 0 ? tools::kDone : tools::kNoPose;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"The SLAM over very many frames of simulated corners", "long_run"};
  app.add_option("--scene", arguments.walk.scene,
                 "A scene of the simulator, or hall: 2,000 markers on a ceiling of 50 x 40 m")
      ->capture_default_str();
  app.add_option("--seed", arguments.walk.seed)->capture_default_str();
  app.add_option("--loop", arguments.walk.loop_s, "Seconds until the way repeats itself")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--frames", arguments.frames)->capture_default_str()->check(CLI::PositiveNumber);
  app.add_option("--report-every", arguments.report_every, "Frames between two lines")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--json", arguments.json_file, "The lines as JSON, to this file");
  app.add_option("--sigma", arguments.sigma_px, "Noise of the corners, pixels")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(arguments);
}
