// The filter of natural features over a gap between markers, as live: how far off it is at the end
// of the gap, whether it says so, how far the published pose would jump at the next marker, and
// what a frame costs.
//
//   natural_filter dolly [--width 640 --height 480 --rate 60 --seeds 3 --duration 12]
//   natural_filter davison DIRECTORY [--picture FILE.png]
//
// dolly: the simulator's scene (seed 2, section 4.1), markers by their projected corners. davison:
// the sequence of Davison's MonoSLAM with its four known points and nothing else.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "base/clock.h"
#include "simulator/observed_corners.h"
#include "simulator/projected_marker.h"
#include "simulator/simulation.h"
#include "slam/natural/filter/visual_filter.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using slam::Matrix6d;
using slam::Transform;
using slam::Vector6d;

struct Arguments {
  int width = 320;
  int height = 240;
  double rate_hz = 30.0;
  double duration_s = 12.0;
  int seeds = 3;
  int features = 60;
  std::string directory;
  std::string picture;
  bool every_frame = false;
};

// Milliseconds of frames.
struct Times {
  std::vector<double> ms;

  void print() {
    std::sort(ms.begin(), ms.end());
    double mean = 0.0;
    for (const double t : ms) mean += t / static_cast<double>(ms.size());
    std::printf("  CPU of a frame: mean %.2f, p99 %.2f, worst %.2f ms (%zu frames)\n", mean,
                ms[ms.size() * 99 / 100], ms.back(), ms.size());
  }
};

template <typename Work>
double cpuMs(const Work& work) {
  const std::int64_t before_ns = threadCpuNs();
  work();
  return 1e-6 * static_cast<double>(threadCpuNs() - before_ns);
}

slam::VisualFilterOptions filterOptions(const Arguments& arguments) {
  slam::VisualFilterOptions options;
  options.filter.max_features = arguments.features;
  return options;
}

double nees(const slam::FilteredPose& pose, const Transform& truth) {
  const Vector6d e = pose.T_w_c.localCoordinates(truth);
  return e.dot(pose.covariance.ldlt().solve(e));
}

// --- The dolly ---------------------------------------------------------------------------------

// The map's markers have errors of a millimetre and 2 mrad.
constexpr double kMapSigma_m = 0.001;
constexpr double kMapSigma_rad = 0.002;

slam::KnownMarker knownMarker(const slam::MarkerDetection& detection, const simulator::Marker& m) {
  slam::KnownMarker known{&detection, m.T_w_m, m.size_m, Matrix6d::Zero(),
                          slam::markerCorners(m.size_m)};
  for (Eigen::Vector3d& corner : known.corners_w) corner = m.T_w_m * corner;
  known.covariance.diagonal() << Eigen::Vector3d::Constant(kMapSigma_m * kMapSigma_m),
      Eigen::Vector3d::Constant(kMapSigma_rad * kMapSigma_rad);
  return known;
}

// Those in view that are large enough for a detector to read their codes.
std::vector<simulator::Marker> readableMarkers(const simulator::Simulation& scene,
                                               const slam::CameraModel& camera, std::int64_t k) {
  constexpr double kShortest_px = 16.0;
  std::vector<simulator::Marker> markers = scene.visibleMarkers(k);
  std::erase_if(markers, [&](const simulator::Marker& marker) {
    const auto corners = simulator::projectMarker(camera, scene.poseAt(k), marker);
    return !corners || simulator::shortestSide(*corners) < kShortest_px;
  });
  return markers;
}

tools::ExitCode runDolly(const Arguments& arguments) {
  for (int seed = 1; seed <= arguments.seeds; ++seed) {
    simulator::Options options;
    options.scene = "dolly";
    options.seed = static_cast<std::uint64_t>(seed);
    options.size = simulator::ImageSize{arguments.width, arguments.height};
    options.rate_hz = arguments.rate_hz;
    options.duration_s = arguments.duration_s;
    const auto simulation = simulator::Simulation::create(options, simulator::Ending::kOfTheScene);
    if (!simulation) {
      std::fprintf(stderr, "natural_filter: %s\n", simulation.error().message.c_str());
      return tools::kBadInput;
    }
    const simulator::Simulation& scene = **simulation;
    const slam::CameraModel camera(scene.camera());
    slam::VisualFilter filter(filterOptions(arguments));
    simulator::Simulation::Workspace workspace;
    std::vector<std::uint8_t> pixels(static_cast<std::size_t>(arguments.width) *
                                     static_cast<std::size_t>(arguments.height));
    Times times;
    std::optional<Transform> gap_began;  // the truth in the last frame with a marker
    bool in_gap = false;
    double worst_ratio = 0.0;
    int beyond = 0, gap_frames = 0, least_believed = 1000;
    for (std::int64_t k = 0; k < scene.frameCount(); ++k) {
      scene.render(k, &workspace, pixels.data());
      const Transform truth = scene.poseAt(k);
      const auto seen = simulator::observeCorners(camera, truth, readableMarkers(scene, camera, k),
                                                  static_cast<std::uint64_t>(k), {.sigma_px = 0.1});
      std::vector<slam::KnownMarker> known;
      for (const slam::MarkerDetection& detection : seen) {
        for (const simulator::Marker& marker : scene.markers()) {
          if (marker.id == detection.id) known.push_back(knownMarker(detection, marker));
        }
      }
      if (!filter.running()) {
        if (known.empty()) continue;
        // A rough pose, as a single far marker gives it.
        filter.reinitialize(truth, Matrix6d(4e-4 * Matrix6d::Identity()));
      } else {
        times.ms.push_back(cpuMs([&] { filter.predict(1.0 / arguments.rate_hz); }));
      }
      const slam::FilteredPose before = filter.pose();
      slam::VisualUpdate update;
      const double ms = cpuMs([&] {
        update = filter.update({pixels.data(), arguments.width, arguments.height, arguments.width},
                               camera, known);
      });
      if (!times.ms.empty()) times.ms.back() += ms;
      const slam::FilteredPose pose = filter.pose();
      const double error = (pose.T_w_c.p - truth.p).norm();
      const double sigma = std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace());
      if (arguments.every_frame) {
        std::printf(
            "%lld markers %zu expected %d found %d believed %d added %d dropped %d error "
            "%.1f mm sigma %.1f nees %.1f %.2f ms noise %.2f anchors %d\n",
            static_cast<long long>(k), known.size(), update.expected, update.found, update.believed,
            update.added, update.dropped, 1e3 * error, 1e3 * sigma, nees(pose, truth), ms,
            filter.filter().noiseScale(), filter.filter().anchorCount());
      }
      if (known.empty()) {
        in_gap = true;
        ++gap_frames;
        least_believed = std::min(least_believed, update.believed);
        worst_ratio = std::max(worst_ratio, error / sigma);
        beyond += error > 3.0 * sigma;
      } else {
        if (in_gap && gap_began) {
          const Vector6d e = before.T_w_c.localCoordinates(truth);
          const double length = (truth.p - gap_began->p).norm();
          std::printf(
              "dolly %dx%d %.0f Hz seed %d: after %.2f m %.1f mm (%.2f %%), %.2f mrad, "
              "NEES %.1f, sigma %.1f mm; jump %.1f mm, then %.1f mm; noise x%.2f\n",
              arguments.width, arguments.height, arguments.rate_hz, seed, length,
              1e3 * e.head<3>().norm(), 100.0 * e.head<3>().norm() / length,
              1e3 * e.tail<3>().norm(), nees(before, truth),
              1e3 * std::sqrt(before.covariance.topLeftCorner<3, 3>().trace()),
              1e3 * (pose.T_w_c.p - before.T_w_c.p).norm(), 1e3 * error,
              filter.filter().noiseScale());
          std::printf(
              "  in the gap: %d frames, least features %d, worst error / sigma %.1f, "
              "beyond 3 sigma %d\n",
              gap_frames, least_believed, worst_ratio, beyond);
        }
        in_gap = false;
        gap_began = truth;
      }
    }
    times.print();
  }
  return tools::kDone;
}

// --- Davison's sequence ------------------------------------------------------------------------

// Davison's lens, r_d = r_u / sqrt(1 + 2 K r_u^2) with r in pixels, as our rational one: the Pade
// approximation of (1 + x)^(-1/2), within 1e-4 px of it over this image.
slam::CameraModel davisonCamera() {
  constexpr double kFocal_px = 195.0;
  const double c = 2.0 * 9e-6 * kFocal_px * kFocal_px;
  slam::Calibration calibration{
      .width = 320, .height = 240, .fx = kFocal_px, .fy = kFocal_px, .cx = 162.0, .cy = 125.0};
  calibration.distortion = {0.75 * c, c * c / 16.0,       0.0, 0.0, 0.0,
                            1.25 * c, 5.0 * c * c / 16.0, 0.0};
  return slam::CameraModel(calibration);
}

// The rectangle's corners; Davison's x is to the left and his y upwards.
const std::array<Eigen::Vector3d, 4> kRectangle_w = {
    Eigen::Vector3d(-0.13477, -0.04074, 0.0), Eigen::Vector3d(0.04632, -0.04324, 0.0),
    Eigen::Vector3d(-0.13555, 0.08827, 0.0), Eigen::Vector3d(0.04969, 0.08697, 0.0)};

struct FoundPatch {
  Eigen::Vector2d pixel;
  double correlation;
};

// Where in a square about `centre` the patch correlates best, with a parabola's sub-pixel.
std::optional<FoundPatch> findPatch(const cv::Mat& image, const cv::Mat& patch,
                                    const Eigen::Vector2d& centre, int reach_px) {
  const int half = patch.cols / 2;
  const int x = static_cast<int>(std::lround(centre.x()));
  const int y = static_cast<int>(std::lround(centre.y()));
  const cv::Rect wanted(x - reach_px - half, y - reach_px - half, 2 * (reach_px + half) + 1,
                        2 * (reach_px + half) + 1);
  const cv::Rect region = wanted & cv::Rect(0, 0, image.cols, image.rows);
  if (region.width < patch.cols || region.height < patch.rows) return std::nullopt;
  cv::Mat scores;
  cv::matchTemplate(image(region), patch, scores, cv::TM_CCOEFF_NORMED);
  double best = 0.0;
  cv::Point at;
  cv::minMaxLoc(scores, nullptr, &best, nullptr, &at);
  const auto peak = [](double before, double middle, double after) {
    const double bend = before - 2.0 * middle + after;
    return bend < 0.0 ? 0.5 * (before - after) / bend : 0.0;
  };
  double dx = 0.0;
  double dy = 0.0;
  const auto score = [&scores](int row, int column) {
    return static_cast<double>(scores.at<float>(row, column));
  };
  if (at.x > 0 && at.x + 1 < scores.cols) {
    dx = peak(score(at.y, at.x - 1), best, score(at.y, at.x + 1));
  }
  if (at.y > 0 && at.y + 1 < scores.rows) {
    dy = peak(score(at.y - 1, at.x), best, score(at.y + 1, at.x));
  }
  return FoundPatch{{region.x + at.x + half + dx, region.y + at.y + half + dy}, best};
}

// Map and way from above (x to the right, depth upwards), and the last image.
void drawMap(const slam::VisualFilter& filter, const std::vector<Eigen::Vector3d>& way,
             const std::vector<Eigen::Vector3d>& points, const std::string& file) {
  constexpr int kSide = 800;
  constexpr double kPerMetre = 200.0;
  cv::Mat picture(kSide, kSide, CV_8UC3, cv::Scalar::all(255));
  const auto place = [](const Eigen::Vector3d& p) {
    return cv::Point(static_cast<int>(std::lround(0.5 * kSide + kPerMetre * p.x())),
                     static_cast<int>(std::lround(0.6 * kSide - kPerMetre * p.z())));
  };
  for (const Eigen::Vector3d& p : points) cv::circle(picture, place(p), 2, {190, 190, 190}, -1);
  for (std::size_t i = 1; i < way.size(); ++i) {
    cv::line(picture, place(way[i - 1]), place(way[i]), {200, 60, 0}, 1, cv::LINE_AA);
  }
  for (const Eigen::Vector3d& p : kRectangle_w) cv::circle(picture, place(p), 4, {0, 0, 0}, -1);
  cv::circle(picture, place(filter.pose().T_w_c.p), 5, {0, 0, 220}, -1);
  cv::imwrite(file, picture);
}

tools::ExitCode runDavison(const Arguments& arguments) {
  const std::filesystem::path directory = arguments.directory;
  const slam::CameraModel camera = davisonCamera();
  std::array<cv::Mat, 4> patches;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const auto file = directory / "init" / ("known_patch" + std::to_string(i) + ".pgm");
    patches[i] = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    if (patches[i].empty()) {
      std::fprintf(stderr, "natural_filter: no image: %s\n", file.c_str());
      return tools::kBadInput;
    }
  }
  slam::VisualFilter filter(filterOptions(arguments));
  Transform start;
  start.p = {0.0, 0.0, -0.6};
  Times times;
  std::vector<Eigen::Vector3d> way;
  std::vector<Eigen::Vector3d> points;
  int blind = 0, least = 1000, frames = 0;
  double rectangle_px = 0.0, worst_rectangle_px = 0.0, last_px = -1.0;
  int rectangle_seen = 0, last_seen = -1;
  for (;; ++frames) {
    char name[64];
    std::snprintf(name, sizeof name, "rawoutput%04d.png", frames);
    const std::filesystem::path file = directory / "frames" / name;
    if (!std::filesystem::exists(file)) break;
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    if (image.empty()) break;
    const ImageView view{image.data, image.cols, image.rows,
                         static_cast<std::ptrdiff_t>(image.step)};
    std::vector<slam::KnownMarker> known;
    slam::MarkerDetection rectangle;
    if (frames == 0) {
      for (std::size_t i = 0; i < 4; ++i) {
        const auto pixel = camera.project(start.inverse() * kRectangle_w[i]);
        const auto found = findPatch(image, patches[i], *pixel, 25);
        rectangle.pixels[i] = found->pixel;
        rectangle.normalized[i] = camera.undistort(found->pixel).value();
        const double s = 0.4 / camera.focalLength();
        rectangle.covariance[i] = s * s * Eigen::Matrix2d::Identity();
        std::printf("point %zu: expected at %.1f %.1f, found at %.1f %.1f, correlation %.2f\n", i,
                    pixel->x(), pixel->y(), found->pixel.x(), found->pixel.y(), found->correlation);
      }
      rectangle.id = 0;
      known.push_back({&rectangle, Transform{}, 0.18, Matrix6d::Zero(), kRectangle_w});
      // As Davison's start: 2 cm, and its turn as well.
      filter.reinitialize(start, Matrix6d(4e-4 * Matrix6d::Identity()));
    }
    slam::VisualUpdate update;
    times.ms.push_back(cpuMs([&] {
      if (frames > 0) filter.predict(1.0 / 30.0);
      update = filter.update(frames == 0 ? ImageView{} : view, camera, known);
    }));
    if (frames == 0) {
      std::vector<slam::VisualFilter::KnownPoint> corners;
      for (std::size_t i = 0; i < 4; ++i) {
        const double z = (filter.pose().T_w_c.inverse() * kRectangle_w[i]).z();
        corners.push_back({rectangle.pixels[i], 1.0 / z, 0.01 / z});
      }
      std::printf("%d known points\n", filter.addKnownPoints(view, camera, corners));
      continue;
    }
    blind += update.blind;
    least = std::min(least, update.believed);
    way.push_back(filter.pose().T_w_c.p);
    if (frames % 10 == 0) {
      const slam::FilterState& state = filter.filter().state();
      for (const slam::StateFeature& f : state.features()) {
        if (f.offset < 0 || !(f.rho > 0.05)) continue;
        points.push_back(state.poses()[static_cast<std::size_t>(f.pose)].T_w_s *
                         (Eigen::Vector3d(f.uv.x(), f.uv.y(), 1.0) / f.rho));
      }
    }
    // The rectangle, looked for where it should be: how far off it is.
    double sum = 0.0;
    int count = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const auto pixel = camera.project(filter.pose().T_w_c.inverse() * kRectangle_w[i]);
      if (!pixel || !camera.inImage(*pixel, 8.0)) continue;
      const auto found = findPatch(image, patches[i], *pixel, 15);
      if (!found || found->correlation < 0.85) continue;
      sum += (found->pixel - *pixel).norm();
      ++count;
    }
    if (count >= 3) {
      ++rectangle_seen;
      last_px = sum / count;
      last_seen = frames;
      rectangle_px += last_px;
      worst_rectangle_px = std::max(worst_rectangle_px, last_px);
    }
    if (arguments.every_frame || frames % 100 == 0) {
      const slam::FilteredPose pose = filter.pose();
      std::printf(
          "%4d: %6.3f %6.3f %6.3f, sigma %.1f mm, expected %d found %d believed %d, "
          "rectangle %d corners %.1f px, noise x%.2f\n",
          frames, pose.T_w_c.p.x(), pose.T_w_c.p.y(), pose.T_w_c.p.z(),
          1e3 * std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace()), update.expected,
          update.found, update.believed, count, count > 0 ? sum / count : 0.0,
          filter.filter().noiseScale());
    }
  }
  if (frames < 2) {
    std::fprintf(stderr, "natural_filter: no frames in %s\n", directory.c_str());
    return tools::kBadInput;
  }
  std::printf("davison: %d frames, blind %d, least features believed %d\n", frames, blind, least);
  std::printf(
      "  rectangle seen in %d frames: mean %.2f px, worst %.2f px; last seen in frame %d, "
      "%.2f px\n",
      rectangle_seen, rectangle_px / std::max(1, rectangle_seen), worst_rectangle_px, last_seen,
      last_px);
  times.print();
  if (!arguments.picture.empty()) drawMap(filter, way, points, arguments.picture);
  return tools::kDone;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"The filter of natural features between markers", "natural_filter"};
  app.require_subcommand(1);
  CLI::App* const dolly = app.add_subcommand("dolly", "The simulator's scene");
  dolly->add_option("--width", arguments.width)->capture_default_str();
  dolly->add_option("--height", arguments.height)->capture_default_str();
  dolly->add_option("--rate", arguments.rate_hz, "Frames per second")->capture_default_str();
  dolly->add_option("--duration", arguments.duration_s, "Seconds")->capture_default_str();
  dolly->add_option("--seeds", arguments.seeds)->capture_default_str();
  CLI::App* const davison = app.add_subcommand("davison", "Davison's sequence");
  davison->add_option("directory", arguments.directory)->required();
  davison->add_option("--picture", arguments.picture, "Map and way from above, a PNG file");
  for (CLI::App* const command : {dolly, davison}) {
    command->add_option("--features", arguments.features, "At most")->capture_default_str();
    command->add_flag("--every-frame", arguments.every_frame, "A line for each frame");
  }
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return dolly->parsed() ? bench::runDolly(arguments) : bench::runDavison(arguments);
}
