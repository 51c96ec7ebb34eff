// Detectors side by side on the same simulated frames: how many of the markers they find, how
// exactly, how many that are not there, and what it costs (thread CPU time).
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/clock.h"
#include "simulator/projected_marker.h"
#include "simulator/simulation.h"
#include "tests/bench/command_line.h"
#include "tests/bench/peers.h"
#include "tools/exit_code.h"
#include "tools/stage_timer.h"

namespace waymark::bench {
namespace {

struct Arguments {
  simulator::Options simulation;
  std::vector<int> size = {640, 480};
  std::int64_t frames = 100;
  double min_side_px = 20.0;
  double max_angle_deg = 60.0;
};

// A marker that has to be found.
struct Expected {
  int id = 0;
  ImageCorners corners;
};

// What a detector made of all frames.
struct Score {
  std::vector<double> cpu_ms;
  std::int64_t expected = 0;
  std::int64_t found = 0;
  std::int64_t wrong = 0;    // markers that are not where the detector says
  double squared_px2 = 0.0;  // of the corners found
};

// Every marker in front of the camera, however small, by its true corners.
std::vector<Expected> allMarkers(const simulator::Simulation& simulation,
                                 const slam::CameraModel& camera, std::int64_t frame,
                                 const std::vector<simulator::Marker>& markers) {
  std::vector<Expected> all;
  for (const simulator::Marker& marker : markers) {
    const auto corners = simulator::projectMarker(camera, simulation.poseAt(frame), marker);
    if (corners) all.push_back({marker.id, *corners});
  }
  return all;
}

// The angle between the marker's normal and the line to the camera, degrees.
double viewAngle(const slam::Transform& T_w_c, const simulator::Marker& marker) {
  const Eigen::Vector3d to_camera = (T_w_c.p - marker.T_w_m.p).normalized();
  return std::acos(std::clamp(to_camera.dot(marker.T_w_m.R.col(2)), -1.0, 1.0)) * 180.0 /
         std::numbers::pi;
}

class Bench {
 public:
  Bench(const Arguments& arguments, const simulator::Simulation& simulation)
      : arguments_(arguments), simulation_(simulation), camera_(simulation.camera()) {
    detectors_.push_back(ourDetector(camera_));
    detectors_.push_back(openCvDetector());
    detectors_.push_back(aprilTagDetector());
    scores_.resize(detectors_.size());
  }

  void run() {
    const std::int64_t count = std::min(arguments_.frames, simulation_.frameCount());
    pixels_.resize(static_cast<std::size_t>(camera_.width()) *
                   static_cast<std::size_t>(camera_.height()));
    for (std::int64_t k = 0; k < count; ++k) {
      frame(k * simulation_.frameCount() / count);
    }
    print(count);
  }

 private:
  void frame(std::int64_t index) {
    simulation_.render(index, &workspace_, pixels_.data());
    const ImageView image{pixels_.data(), camera_.width(), camera_.height(), camera_.width()};
    std::vector<simulator::Marker> due;
    for (const simulator::Marker& marker : simulation_.visibleMarkers(index)) {
      if (viewAngle(simulation_.poseAt(index), marker) <= arguments_.max_angle_deg) {
        due.push_back(marker);
      }
    }
    std::vector<Expected> expected = allMarkers(simulation_, camera_, index, due);
    std::erase_if(expected, [&](const Expected& e) {
      return simulator::shortestSide(e.corners) < arguments_.min_side_px;
    });
    const auto there = allMarkers(simulation_, camera_, index, simulation_.markersAt(index));
    for (std::size_t d = 0; d < detectors_.size(); ++d) {
      const std::int64_t before_ns = threadCpuNs();
      const auto found = detectors_[d]->detect(image);
      scores_[d].cpu_ms.push_back(1e-6 * static_cast<double>(threadCpuNs() - before_ns));
      judge(found, expected, there, &scores_[d]);
    }
  }

  static void judge(const std::map<int, ImageCorners>& found, const std::vector<Expected>& expected,
                    const std::vector<Expected>& there, Score* score) {
    score->expected += static_cast<std::int64_t>(expected.size());
    for (const Expected& e : expected) {
      const auto match = found.find(e.id);
      if (match == found.end()) continue;
      ++score->found;
      for (std::size_t k = 0; k < 4; ++k) {
        score->squared_px2 += (match->second[k] - e.corners[k]).squaredNorm();
      }
    }
    for (const auto& [id, corners] : found) {
      constexpr double kNear = 5.0;  // pixels
      const bool right =
          std::any_of(there.begin(), there.end(), [&, &at = corners, id = id](const Expected& e) {
            return e.id == id && (e.corners[0] - at[0]).norm() < kNear;
          });
      if (!right) ++score->wrong;
    }
  }

  void print(std::int64_t count) {
    std::printf("%s, %dx%d, %lld frames, %lld markers of %.0f px and more up to %.0f degrees\n",
                simulation_.scene().name.c_str(), camera_.width(), camera_.height(),
                static_cast<long long>(count), static_cast<long long>(scores_[0].expected),
                arguments_.min_side_px, arguments_.max_angle_deg);
    std::printf("%-14s %9s %9s %9s %9s %9s %6s\n", "", "mean ms", "p99 ms", "max ms", "found",
                "RMS px", "wrong");
    for (std::size_t d = 0; d < detectors_.size(); ++d) {
      const Score& score = scores_[d];
      const tools::TimeSummary cpu_ms = tools::summarize(score.cpu_ms);
      const auto found = static_cast<double>(score.found);
      std::printf("%-14s %9.3f %9.3f %9.3f %8.2f%% %9.3f %6lld\n", detectors_[d]->name().c_str(),
                  cpu_ms.mean, cpu_ms.p99, cpu_ms.max,
                  100.0 * found / static_cast<double>(std::max<std::int64_t>(score.expected, 1)),
                  std::sqrt(score.squared_px2 / std::max(4.0 * found, 1.0)),
                  static_cast<long long>(score.wrong));
    }
  }

  const Arguments& arguments_;
  const simulator::Simulation& simulation_;
  slam::CameraModel camera_;
  std::vector<std::unique_ptr<Detector>> detectors_;
  std::vector<Score> scores_;
  std::vector<std::uint8_t> pixels_;
  simulator::Simulation::Workspace workspace_;
};

tools::ExitCode run(Arguments arguments) {
  arguments.simulation.dictionary = "APRILTAG_36h11";
  arguments.simulation.size = {arguments.size[0], arguments.size[1]};
  const auto simulation =
      simulator::Simulation::create(arguments.simulation, simulator::Ending::kOfTheScene);
  if (!simulation) {
    std::fprintf(stderr, "detection_bench: %s\n", simulation.error().message.c_str());
    return tools::kBadInput;
  }
  Bench(arguments, **simulation).run();
  return tools::kDone;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Detectors side by side on simulated frames", "detection_bench"};
  app.add_option("--scene", arguments.simulation.scene, "As for waymark simulate")
      ->capture_default_str();
  app.add_option("--seed", arguments.simulation.seed)->capture_default_str();
  app.add_option("--size", arguments.size, "Width and height, pixels")
      ->capture_default_str()
      ->expected(2);
  app.add_option("--frames", arguments.frames, "Spread over the sequence")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--noise", arguments.simulation.noise_sigma, "Grey levels")->capture_default_str();
  app.add_option("--exposure", arguments.simulation.exposure_s, "Seconds")->capture_default_str();
  app.add_option("--min-side", arguments.min_side_px, "Of markers that count, pixels")
      ->capture_default_str();
  app.add_option("--max-angle", arguments.max_angle_deg, "Of markers that count, degrees")
      ->capture_default_str();
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(arguments);
}
