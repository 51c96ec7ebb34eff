// The SLAM over millions of frames of simulated corners, or through a map of thousands of markers:
// does its time per frame stay flat, its memory bounded, its map sound?
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <unistd.h>

#include "base/quantile.h"
#include "bench/cpu_time.h"
#include "bench/walk.h"
#include "io/map_file.h"
#include "io/number_text.h"
#include "simulator/observed_corners.h"
#include "slam/geometry/align_points.h"
#include "slam/slam.h"
#include "tools/evaluation.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

struct Arguments {
  WalkOptions walk;
  std::int64_t frames = 1'000'000;
  std::int64_t report_every = 100'000;
  double sigma_px = 0.1;
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
std::string ateText(const Stretch& stretch) {
  if (stretch.estimate.empty()) return "-";
  const slam::Transform T = slam::alignPoints(stretch.estimate, stretch.truth);
  double sum_m = 0.0;
  for (std::size_t i = 0; i < stretch.truth.size(); ++i) {
    sum_m += (T * stretch.estimate[i] - stretch.truth[i]).norm();
  }
  return io::fixed(1000.0 * sum_m / static_cast<double>(stretch.truth.size()), 3);
}

void printHead() {
  std::printf("%9s %8s %9s %9s %9s %9s %9s %9s %9s %9s\n", "frames", "markers", "keyframes",
              "localised", "mean ms", "p99 ms", "max ms", "MB", "ATE mm", "ACE mm");
}

void print(std::int64_t frames, const slam::Slam& slam, std::span<const io::MarkerCorners> layout,
           Stretch stretch) {
  std::sort(stretch.cpu_ms.begin(), stretch.cpu_ms.end());
  const std::span<const double> sorted(stretch.cpu_ms);
  double sum_ms = 0.0;
  for (const double ms : sorted) sum_ms += ms;
  const auto count = static_cast<double>(sorted.size());
  const std::vector<io::MarkerCorners> map = io::posedMarkerCorners(slam.map());
  const auto errors = tools::compareMaps(layout, map);
  std::printf("%9lld %8zu %9zu %8.2f%% %9.4f %9.4f %9.4f %9.1f %9s %9s\n",
              static_cast<long long>(frames), map.size(), slam.map().keyframes().size(),
              100.0 * static_cast<double>(stretch.estimate.size()) / count, sum_ms / count,
              quantile(sorted, 990), sorted.back(), residentMegabytes(), ateText(stretch).c_str(),
              errors ? io::fixed(1000.0 * errors->ace_m.mean, 3).c_str() : "-");
  std::fflush(stdout);
}

tools::ExitCode run(const Arguments& arguments) {
  const Result<Walk> planned = planWalk(arguments.walk);
  if (!planned) {
    std::fprintf(stderr, "long_run: %s\n", planned.error().message.c_str());
    return tools::kBadInput;
  }
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
  for (std::int64_t k = 0; k < arguments.frames; ++k) {
    const Walk::Frame& frame = walk.frames[static_cast<std::size_t>(k) % walk.frames.size()];
    const auto sequence = static_cast<std::uint64_t>(k);
    const auto time_ns = static_cast<std::int64_t>(1e9 * static_cast<double>(k) / walk.rate_hz);
    const std::vector<slam::MarkerDetection> detections =
        simulator::observeCorners(camera, frame.T_w_c, frame.in_view, sequence, noise);
    const double before_ms = threadCpu_ms();
    const slam::FrameResult result = slam.processDetections(detections, {sequence, time_ns});
    stretch.cpu_ms.push_back(threadCpu_ms() - before_ms);
    if (result.pose) {
      stretch.truth.push_back(frame.T_w_c.p);
      stretch.estimate.push_back(result.pose->T_w_c.p);
    }
    if ((k + 1) % arguments.report_every == 0 || k + 1 == arguments.frames) {
      print(k + 1, slam, layout, std::move(stretch));
      stretch = {};
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
  app.add_option("--sigma", arguments.sigma_px, "Noise of the corners, pixels")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help
    std::fprintf(stderr, "long_run: %s\n", io::oneLine(e.what()).c_str());
    return tools::kBadInput;
  }
  return bench::run(arguments);
}
