// Frames of clutter without a single marker: who finds some all the same, and what looking costs
// (thread CPU time). And frames full of patterns without end.
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/clock.h"
#include "tests/bench/clutter.h"
#include "tests/bench/command_line.h"
#include "tests/bench/pattern_runs.h"
#include "tests/bench/peers.h"
#include "tools/calibration/board_detector.h"
#include "tools/exit_code.h"
#include "tools/stage_timer.h"

namespace waymark::bench {
namespace {

struct Arguments {
  std::vector<int> size = {640, 480};
  std::int64_t frames = 1000;
  std::uint64_t seed = 1;
  double noise_sigma = 3.0;
  bool alone = false;
  std::string picture;
  bool patterns = false;
  int repeats = 3;
};

struct Score {
  std::vector<double> cpu_ms;
  std::int64_t ids = 0;
  std::int64_t frames = 0;  // with an id
};

void run(const Arguments& arguments) {
  constexpr int kCells = 8;  // of tag36h11, with its border
  ClutterPainter painter(arguments.size[0], arguments.size[1], kCells, arguments.noise_sigma);
  const slam::CameraModel camera(
      calibration::roughCalibration(arguments.size[0], arguments.size[1]));
  std::vector<std::unique_ptr<Detector>> detectors;
  detectors.push_back(ourDetector(camera));
  if (!arguments.alone) {
    detectors.push_back(openCvDetector());
    detectors.push_back(aprilTagDetector());
  }
  std::vector<Score> scores(detectors.size());
  for (std::int64_t frame = 0; frame < arguments.frames; ++frame) {
    const ImageView image = painter.paint(arguments.seed + static_cast<std::uint64_t>(frame));
    if (frame == 0 && !arguments.picture.empty()) {
      cv::imwrite(arguments.picture,
                  cv::Mat(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.data),
                          static_cast<std::size_t>(image.stride)));
    }
    for (std::size_t d = 0; d < detectors.size(); ++d) {
      const std::int64_t before_ns = threadCpuNs();
      const auto found = detectors[d]->detect(image);
      scores[d].cpu_ms.push_back(1e-6 * static_cast<double>(threadCpuNs() - before_ns));
      scores[d].ids += static_cast<std::int64_t>(found.size());
      scores[d].frames += found.empty() ? 0 : 1;
    }
  }
  std::printf("clutter, %dx%d, %lld frames without a marker\n", arguments.size[0],
              arguments.size[1], static_cast<long long>(arguments.frames));
  std::printf("%-14s %9s %9s %9s %10s %12s\n", "", "mean ms", "p99 ms", "max ms", "false ids",
              "in frames");
  for (std::size_t d = 0; d < detectors.size(); ++d) {
    const tools::TimeSummary cpu_ms = tools::summarize(scores[d].cpu_ms);
    std::printf("%-14s %9.3f %9.3f %9.3f %10lld %12lld\n", detectors[d]->name().c_str(),
                cpu_ms.mean, cpu_ms.p99, cpu_ms.max, static_cast<long long>(scores[d].ids),
                static_cast<long long>(scores[d].frames));
  }
}

int patterns(const Arguments& arguments) {
  const auto within = runPatterns({.width = arguments.size[0],
                                   .height = arguments.size[1],
                                   .frames = static_cast<int>(arguments.frames),
                                   .repeats = arguments.repeats,
                                   .seed = arguments.seed});
  if (!within) return tools::kBadInput;
  return *within ? tools::kDone : 1;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Detectors on frames of clutter without markers", "clutter_bench"};
  app.add_option("--size", arguments.size, "Width and height, pixels")
      ->capture_default_str()
      ->expected(2)
      ->check(CLI::Range(64, 8192));
  app.add_option("--frames", arguments.frames)->capture_default_str()->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed, "Of the first frame; the next ones count on")
      ->capture_default_str();
  app.add_option("--noise", arguments.noise_sigma, "Grey levels")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  app.add_flag("--alone", arguments.alone, "Our detector only");
  app.add_option("--picture", arguments.picture, "The first frame as an image file");
  app.add_flag("--patterns", arguments.patterns,
               "Patterns instead of clutter, from frame to frame; fails where one takes too long");
  app.add_option("--repeats", arguments.repeats, "Of patterns; the shortest time counts")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  if (arguments.patterns) return bench::patterns(arguments);
  bench::run(arguments);
  return tools::kDone;
}
