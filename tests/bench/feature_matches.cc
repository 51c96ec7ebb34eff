// How far the matches of natural features are beside the truth, by how much their patches are
// stretched, and what that makes of the pose: rendered scenes, the filter alone, markers by their
// projected corners.
//
//   feature_matches corridor [--runs 1 --width 640 --height 480 --rate 30]
//
// "outward": along the way from the image's middle, where an error of all of them is one of the
// scale. "surface": how far the gradient of the surface that a patch is warped with is off, as a
// tangent.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>

#include "base/clock.h"
#include "simulator/observed_corners.h"
#include "simulator/projected_marker.h"
#include "simulator/simulation.h"
#include "slam/natural/filter/visual_filter.h"
#include "tests/bench/command_line.h"
#include "tests/bench/kept_frames.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using slam::Matrix6d;
using slam::Transform;

struct Arguments {
  std::vector<std::string> scenes = {"corridor"};
  int runs = 1;
  std::uint64_t seed = 1;
  int width = 0;
  int height = 0;
  double rate_hz = 0.0;
  double duration_s = 0.0;
  bool every_gap = false;
  bool true_surfaces = false;
  std::string keep;  // a folder; empty: none
};

// Of matches whose patches are stretched by so much.
struct Tally {
  int count = 0;
  double squares = 0.0;   // pixels^2, of both coordinates
  double outward = 0.0;   // pixels
  double whitened = 0.0;  // squares over what is said of them
  double surface = 0.0;   // squared
  int with_surface = 0;
};
constexpr std::array<double, 6> kStretches = {0.1, 0.2, 0.4, 0.8, 1.5, 1e9};

// Where a feature is in truth.
struct TruePoint {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  Eigen::Vector2d surface = Eigen::Vector2d::Zero();
};

struct Gap {
  double way_m = 0.0, error_m = 0.0, sigma_m = 0.0, nees = 0.0;
};

class Run {
 public:
  Run(const simulator::Simulation& scene, const Arguments& arguments,
      std::array<Tally, kStretches.size()>* tallies, std::vector<Gap>* gaps)
      : scene_(scene),
        arguments_(arguments),
        camera_(scene.camera()),
        filter_(slam::VisualFilterOptions{}),
        frames_(scene, arguments.keep),
        points_(static_cast<std::size_t>(slam::FeatureFilterOptions{}.max_features)),
        tallies_(tallies),
        gaps_(gaps) {}

  void all() {
    for (std::int64_t k = 0; k < scene_.frameCount(); ++k) step(k);
  }
  double cpu_ms = 0.0;
  int frames = 0;

 private:
  void step(std::int64_t k) {
    frames_.next(k, &pixels_);
    const Transform truth = scene_.poseAt(k);
    const auto seen = simulator::observeCorners(camera_, truth, readable(k),
                                                static_cast<std::uint64_t>(k), {.sigma_px = 0.1});
    std::vector<slam::KnownMarker> known;
    for (const slam::MarkerDetection& detection : seen) {
      for (const simulator::Marker& m : scene_.markers()) {
        if (m.id == detection.id) known.push_back(knownMarker(detection, m));
      }
    }
    const std::int64_t before_ns = threadCpuNs();
    const bool begins = !filter_.running();
    if (begins) {
      if (known.empty()) return;
      filter_.reinitialize(truth, Matrix6d(4e-4 * Matrix6d::Identity()));
    } else {
      filter_.predict(1.0 / scene_.scene().rate_hz);
    }
    const slam::Calibration& lens = scene_.camera();
    (void)filter_.update({pixels_.data(), lens.width, lens.height, lens.width}, camera_, known);
    cpu_ms += 1e-6 * static_cast<double>(threadCpuNs() - before_ns);
    ++frames;
    count(truth);
    noteNew(truth);
    noteGap(truth, !known.empty());
  }

  [[nodiscard]] std::vector<simulator::Marker> readable(std::int64_t k) const {
    constexpr double kShortest_px = 16.0;
    std::vector<simulator::Marker> markers = scene_.visibleMarkers(k);
    std::erase_if(markers, [&](const simulator::Marker& marker) {
      const auto corners = simulator::projectMarker(camera_, scene_.poseAt(k), marker);
      return !corners || simulator::shortestSide(*corners) < kShortest_px;
    });
    return markers;
  }
  static slam::KnownMarker knownMarker(const slam::MarkerDetection& detection,
                                       const simulator::Marker& m) {
    slam::KnownMarker known{&detection, m.T_w_m, m.size_m, Matrix6d(1e-10 * Matrix6d::Identity()),
                            slam::markerCorners(m.size_m)};
    for (Eigen::Vector3d& corner : known.corners_w) corner = m.T_w_m * corner;
    return known;
  }

  void count(const Transform& truth) {
    const slam::Calibration& lens = scene_.camera();
    const Eigen::Vector2d middle(0.5 * lens.width, 0.5 * lens.height);
    for (const auto& shown : filter_.shown()) {
      const auto& point = points_[static_cast<std::size_t>(shown.feature)];
      if (!shown.believed || !point) continue;
      const auto at = camera_.project(truth.inverse() * point->p_w);
      if (!at) continue;
      const Eigen::Vector2d error = shown.match - *at;
      if (error.norm() > 6.0) continue;  // of something else
      std::size_t bin = 0;
      while (shown.stretch > kStretches[bin]) ++bin;
      Tally& tally = (*tallies_)[bin];
      ++tally.count;
      tally.squares += error.squaredNorm();
      tally.outward += error.dot((*at - middle).normalized());
      tally.whitened += error.squaredNorm() / (2.0 * shown.sigma_px * shown.sigma_px);
      tally.surface += (filter_.surfaceOf(shown.feature) - point->surface).squaredNorm();
    }
  }

  void noteNew(const Transform& truth) {
    const slam::FilterState& state = filter_.filter().state();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const slam::StateFeature& f = state.features()[i];
      if (f.offset < 0) {
        points_[i].reset();
        continue;
      }
      if (filter_.ageOf(static_cast<int>(i)) > 0) continue;
      const Eigen::Vector2d pixel = camera_.distort(f.uv);
      const int x = static_cast<int>(std::lround(pixel.x()));
      const int y = static_cast<int>(std::lround(pixel.y()));
      if ((pixel - Eigen::Vector2d(x, y)).norm() > 1e-6) continue;  // seen before
      points_[i].reset();
      points_[i] = pointAt(truth, {f.uv.x(), f.uv.y(), 1.0});
      if (!points_[i]) continue;
      if (arguments_.true_surfaces) filter_.tellSurface(static_cast<int>(i), points_[i]->surface);
    }
  }

  // Of the nearest surface that a camera sees there; empty where that moves.
  [[nodiscard]] std::optional<TruePoint> pointAt(const Transform& T_w_c,
                                                 const Eigen::Vector3d& ray_c) const {
    std::optional<TruePoint> nearest;
    double nearest_m = 1e9;
    for (const simulator::Surface& surface : scene_.scene().surfaces) {
      if (surface.motion) continue;
      const Eigen::Vector3d n_c = T_w_c.R.transpose() * surface.T_w_s.R.col(2);
      const double z = n_c.dot(T_w_c.inverse() * surface.T_w_s.p) / n_c.dot(ray_c);
      if (!(z > 0.05) || !(z < nearest_m)) continue;
      const Eigen::Vector3d p_w = T_w_c * (z * ray_c);
      const Eigen::Vector3d p_s = surface.T_w_s.inverse() * p_w;
      if (std::abs(p_s.x()) > surface.half_width_m || std::abs(p_s.y()) > surface.half_height_m) {
        continue;
      }
      nearest_m = z;
      nearest = TruePoint{p_w, n_c.head<2>() / n_c.dot(ray_c)};
    }
    return nearest;
  }

  void noteGap(const Transform& truth, bool marker) {
    if (marker) {
      if (gap_ && gap_->way_m > 0.5) gaps_->push_back(*gap_);
      if (gap_ && gap_->way_m > 0.5 && arguments_.every_gap) {
        std::printf("  way %.2f m, off %.1f mm (%.2f %%), sigma %.1f, NEES %.1f\n", gap_->way_m,
                    1e3 * gap_->error_m, 100.0 * gap_->error_m / gap_->way_m, 1e3 * gap_->sigma_m,
                    gap_->nees);
      }
      gap_ = Gap{};
    } else if (gap_) {
      gap_->way_m += (truth.p - before_.p).norm();
      const slam::FilteredPose pose = filter_.pose();
      const slam::Vector6d e = pose.T_w_c.localCoordinates(truth);
      gap_->error_m = e.head<3>().norm();
      gap_->sigma_m = std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace());
      gap_->nees = e.dot(pose.covariance.ldlt().solve(e));
    }
    before_ = truth;
  }

  const simulator::Simulation& scene_;
  const Arguments& arguments_;
  slam::CameraModel camera_;
  slam::VisualFilter filter_;
  KeptFrames frames_;
  std::vector<std::uint8_t> pixels_;
  std::vector<std::optional<TruePoint>> points_;
  std::array<Tally, kStretches.size()>* tallies_;
  std::vector<Gap>* gaps_;
  std::optional<Gap> gap_;
  Transform before_;
};

void print(const std::array<Tally, kStretches.size()>& tallies, const std::vector<Gap>& gaps) {
  for (std::size_t i = 0; i < tallies.size(); ++i) {
    const Tally& t = tallies[i];
    if (t.count == 0) continue;
    std::printf(
        "  stretched up to %-5.1f %7d matches: %.3f px rms of a coordinate, outward %+.3f, chi2 "
        "%.2f; surface off %.2f\n",
        kStretches[i], t.count, std::sqrt(0.5 * t.squares / t.count), t.outward / t.count,
        t.whitened / t.count, std::sqrt(t.surface / t.count));
  }
  double share = 0.0, nees = 0.0, mm = 0.0;
  for (const Gap& gap : gaps) {
    share += std::pow(gap.error_m / gap.way_m, 2) / static_cast<double>(gaps.size());
    mm += std::pow(1e3 * gap.error_m, 2) / static_cast<double>(gaps.size());
    nees += gap.nees / static_cast<double>(gaps.size());
  }
  std::printf("  %zu gaps: off at the end by %.2f %% rms, %.1f mm, NEES %.1f\n", gaps.size(),
              100.0 * std::sqrt(share), std::sqrt(mm), nees);
}

tools::ExitCode run(const Arguments& arguments) {
  for (const std::string& name : arguments.scenes) {
    std::array<Tally, kStretches.size()> tallies{};
    std::vector<Gap> gaps;
    double cpu_ms = 0.0;
    int frames = 0;
    for (int i = 0; i < arguments.runs; ++i) {
      simulator::Options options;
      options.scene = name;
      options.seed = arguments.seed + static_cast<std::uint64_t>(i);
      if (arguments.width > 0)
        options.size = simulator::ImageSize{arguments.width, arguments.height};
      if (arguments.rate_hz > 0.0) options.rate_hz = arguments.rate_hz;
      if (arguments.duration_s > 0.0) options.duration_s = arguments.duration_s;
      const auto made = simulator::Simulation::create(options, simulator::Ending::kOfTheScene);
      if (!made) {
        std::fprintf(stderr, "feature_matches: %s\n", made.error().message.c_str());
        return tools::kBadInput;
      }
      Run one(**made, arguments, &tallies, &gaps);
      one.all();
      cpu_ms += one.cpu_ms;
      frames += one.frames;
    }
    std::printf("%s: %d frames, %.2f ms each\n", name.c_str(), frames,
                cpu_ms / std::max(1, frames));
    print(tallies, gaps);
  }
  return tools::kDone;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Matches of natural features beside the truth", "feature_matches"};
  app.add_option("scenes", arguments.scenes, "Scenes of the simulator")->capture_default_str();
  app.add_option("--runs", arguments.runs, "Seeds of each")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed, "Of the first run")->capture_default_str();
  CLI::Option* width = app.add_option("--width", arguments.width, "Pixels; without it the scene's");
  app.add_option("--height", arguments.height, "Pixels")->needs(width);
  app.add_option("--rate", arguments.rate_hz, "Hz; without it the scene's");
  app.add_option("--duration", arguments.duration_s, "Seconds; without it the scene's");
  app.add_flag("--every-gap", arguments.every_gap, "A line for each");
  app.add_option("--keep", arguments.keep,
                 "Rendered frames are kept in this folder, and taken from there");
  app.add_flag("--true-surfaces", arguments.true_surfaces,
               "Patches are warped with their surfaces as they are");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(arguments);
}
