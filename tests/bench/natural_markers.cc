// Natural markers: posters on a wall, rendered with exact truth. How many of those in view are
// found, how many wrong ones, how far off, in what time; kinds of features side by side, by
// distance, tilt, blur and occlusion, and by the number of pictures known.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <opencv2/core.hpp>

#include "base/clock.h"
#include "simulator/album.h"
#include "simulator/poster.h"
#include "simulator/random.h"
#include "simulator/renderer.h"
#include "simulator/scene.h"
#include "simulator/sensor.h"
#include "slam/natural/pictures/picture_finder.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

using slam::NaturalMarker;
using slam::Transform;

struct Arguments {
  int views = 40;  // of each condition
  std::uint64_t seed = 1;
  std::vector<std::string> kinds = {"sift", "brisk", "akaze", "orb"};
  std::vector<int> numbers = {1, 20, 100};  // of pictures known
  std::string directory;                    // of photographs
  // They hang on the wall instead of made-up posters, as far as they go.
  std::vector<simulator::PosterImage> photographs;
  bool verbose = false;
};

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr double kWidth_m = 0.30;
constexpr double kApart_m = 1.1;  // of the posters on the wall
constexpr int kKnown = 20;        // posters on the wall that are in the set
constexpr int kStrange = 10;      // and others between them
constexpr int kNsPerMs = 1'000'000;

struct Condition {
  std::string name;
  double nearest_m, farthest_m;
  double least_tilt_deg, most_tilt_deg;
  double blur_px;   // the image moves so far while it is exposed
  double occluded;  // share of the poster's box
  int width = 640;
};

std::vector<Condition> conditions() {
  return {
      {"0.3 to 1 m", 0.3, 1.0, 0.0, 30.0, 0.0, 0.0},
      {"1 to 2 m", 1.0, 2.0, 0.0, 30.0, 0.0, 0.0},
      {"2 to 3 m", 2.0, 3.0, 0.0, 30.0, 0.0, 0.0},
      {"tilt 30 to 50", 0.5, 1.5, 30.0, 50.0, 0.0, 0.0},
      {"tilt 50 to 65", 0.5, 1.5, 50.0, 65.0, 0.0, 0.0},
      {"blur 4 px", 0.5, 1.5, 0.0, 30.0, 4.0, 0.0},
      {"blur 8 px", 0.5, 1.5, 0.0, 30.0, 8.0, 0.0},
      {"30 % hidden", 0.5, 1.5, 0.0, 30.0, 0.0, 0.3},
      {"50 % hidden", 0.5, 1.5, 0.0, 30.0, 0.0, 0.5},
      {"320x240", 0.3, 1.5, 0.0, 30.0, 0.0, 0.0, 320},
  };
}

slam::Calibration lens(int width) {
  slam::Calibration c;
  c.width = width;
  c.height = width * 3 / 4;
  c.fx = 0.8 * width;
  c.fy = 1.002 * c.fx;
  c.cx = 0.5 * (width - 1) + 3.0;
  c.cy = 0.5 * (c.height - 1) - 4.0;
  c.distortion = {-0.20, 0.05, 0.0005, -0.0007};
  return c;
}

constexpr std::uint64_t kStrangeFrom = 50'000;  // numbers of posters that are not in the set

simulator::PosterImage posterOf(const Arguments& arguments, std::uint64_t number) {
  const bool strange = number >= kStrangeFrom;
  const std::uint64_t photograph = strange ? kKnown + (number - kStrangeFrom) / 3 : number;
  if (photograph < arguments.photographs.size()) return arguments.photographs[photograph];
  return simulator::makePoster(arguments.seed * 100'000 + number);
}

// A wall in the plane z = 0 of the world, x along it and y up; posters in a row, known and strange
// ones mixed.
class Wall {
 public:
  Wall(const Arguments& arguments, int width) {
    simulator::Scene scene{.name = "wall",
                           .dictionary = *slam::Dictionary::byName("4X4_50"),
                           .camera = lens(width),
                           .surfaces = {},
                           .markers = {},
                           .prints = {},
                           .trajectory = {}};
    const double length = kApart_m * (kKnown + kStrange);
    simulator::Surface surface;
    surface.T_w_s.p.x() = 0.5 * length;
    surface.half_width_m = 0.5 * length + 4.0;
    surface.half_height_m = 3.0;
    surface.paint = {.patches_per_m2 = 3.0, .texel_m = 0.004};
    scene.surfaces.push_back(surface);
    for (int i = 0; i < kKnown + kStrange; ++i) {
      // Every third is strange.
      const bool strange = i % 3 == 2;
      const auto number = static_cast<std::uint64_t>(strange ? i : i - i / 3);
      const simulator::PosterImage poster =
          posterOf(arguments, strange ? kStrangeFrom + number : number);
      Transform T_w_p;
      T_w_p.p = {kApart_m * (i + 0.5), 0.15 * std::sin(2.0 * i), 0.002};
      scene.prints.push_back({std::make_shared<simulator::PrintedImage>(poster.view()), kWidth_m,
                              kWidth_m * poster.height / poster.width, T_w_p});
      if (!strange) known.push_back(scene.prints.back());
    }
    camera.emplace(scene.camera);
    simulator::Options options;
    options.seed = arguments.seed;
    auto made = simulator::Renderer::create(scene, arguments.seed,
                                            simulator::Sensor::blurRadius(options) + 1);
    renderer.emplace(std::move(*made));
    sensor.emplace(options, simulator::ImageSize{scene.camera.width, scene.camera.height});
  }

  std::vector<simulator::Print> known;  // in the order of the set
  std::optional<slam::CameraModel> camera;
  std::optional<simulator::Renderer> renderer;
  std::optional<simulator::Sensor> sensor;
};

struct View {
  Transform T_w_c;
  std::vector<std::uint8_t> pixels;
};

// Where the camera is: it looks at about the middle of a known poster.
Transform poseFor(const Condition& condition, const simulator::Print& print,
                  simulator::Random* random) {
  const double distance = random->uniform(condition.nearest_m, condition.farthest_m);
  const double tilt =
      kRadPerDeg * random->uniform(condition.least_tilt_deg, condition.most_tilt_deg);
  const double way = random->uniform(-std::numbers::pi, std::numbers::pi);
  const Eigen::Vector3d axis(std::cos(way), std::sin(way), 0.0);
  const Eigen::Vector3d eye =
      print.T_w_p.p + slam::expSo3(tilt * axis) * Eigen::Vector3d(0, 0, distance);
  const double aside = 0.1 * distance;
  const Eigen::Vector3d target = print.T_w_p.p + Eigen::Vector3d(random->uniform(-aside, aside),
                                                                 random->uniform(-aside, aside), 0);
  const Eigen::Vector3d z = (target - eye).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitY()).normalized();
  Transform T_w_c;
  T_w_c.R << x, z.cross(x), z;
  T_w_c.R = T_w_c.R * slam::expSo3({0.0, 0.0, random->uniform(-0.3, 0.3)});
  T_w_c.p = eye;
  return T_w_c;
}

std::array<Eigen::Vector3d, 4> cornersOf(const simulator::Print& print) {
  const double x = 0.5 * print.width_m;
  const double y = 0.5 * print.height_m;
  return {Eigen::Vector3d(-x, y, 0), Eigen::Vector3d(x, y, 0), Eigen::Vector3d(x, -y, 0),
          Eigen::Vector3d(-x, -y, 0)};
}

// Mean distance of the four corners at one pose from those at the other, pixels; very large where
// one is behind the camera.
double cornerError_px(const slam::CameraModel& camera, const simulator::Print& print,
                      const Transform& a, const Transform& b) {
  double sum = 0.0;
  for (const Eigen::Vector3d& corner : cornersOf(print)) {
    const auto at = camera.project(a * corner);
    const auto other = camera.project(b * corner);
    sum += at && other ? (*at - *other).norm() : 1e6;
  }
  return sum / 4.0;
}

View render(const Wall& wall, const Condition& condition, const simulator::Print& print,
            std::uint64_t number, simulator::Random* random) {
  View view;
  view.T_w_c = poseFor(condition, print, random);
  simulator::Renderer::Workspace workspace;
  simulator::Radiance sum;
  const int samples = condition.blur_px > 0.0 ? 12 : 1;
  const double way = random->uniform(-std::numbers::pi, std::numbers::pi);
  const Eigen::Vector3d turn = condition.blur_px / wall.camera->focalLength() *
                               Eigen::Vector3d(std::cos(way), std::sin(way), 0.0);
  for (int i = 0; i < samples; ++i) {
    Transform T_w_c = view.T_w_c;
    T_w_c.R = T_w_c.R * slam::expSo3(((i + 0.5) / samples - 0.5) * turn);
    wall.renderer->render({{T_w_c}}, {}, &workspace);
    if (i == 0) sum = workspace.radiance;
    if (i == 0) continue;
    std::transform(sum.pixels.begin(), sum.pixels.end(), workspace.radiance.pixels.begin(),
                   sum.pixels.begin(), std::plus<>());
  }
  const int width = wall.camera->width();
  const int height = wall.camera->height();
  view.pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  simulator::Sensor::Workspace sensor;
  wall.sensor->develop(sum, 1.0F / static_cast<float>(samples), number, &sensor,
                       view.pixels.data());
  if (condition.occluded <= 0.0) return view;
  // A hand before the poster's box, from one side.
  Eigen::Vector2d low(1e9, 1e9);
  Eigen::Vector2d high(-1e9, -1e9);
  for (const Eigen::Vector3d& corner : cornersOf(print)) {
    const auto pixel = wall.camera->project(view.T_w_c.inverse() * print.T_w_p * corner);
    if (!pixel) return view;
    low = low.cwiseMin(*pixel);
    high = high.cwiseMax(*pixel);
  }
  const bool sideways = random->next() % 2 == 0;
  for (int y = std::max(0, static_cast<int>(low.y())); y < std::min<int>(height, high.y()); ++y) {
    for (int x = std::max(0, static_cast<int>(low.x())); x < std::min<int>(width, high.x()); ++x) {
      const double part =
          sideways ? (x - low.x()) / (high.x() - low.x()) : (y - low.y()) / (high.y() - low.y());
      if (part > condition.occluded) continue;
      view.pixels[static_cast<std::size_t>(y * width + x)] =
          static_cast<std::uint8_t>(130 + 30 * std::sin(0.11 * x) * std::sin(0.13 * y));
    }
  }
  return view;
}

struct Tally {
  int expected = 0, found = 0, wrong = 0, proposed = 0, refused = 0, ambiguous = 0;
  std::vector<double> corner_px, position_mm, angle_deg, nees, milliseconds;

  void add(const Tally& o) {
    expected += o.expected;
    found += o.found;
    wrong += o.wrong;
    proposed += o.proposed;
    refused += o.refused;
    ambiguous += o.ambiguous;
    const auto join = [](std::vector<double>* a, const std::vector<double>& b) {
      a->insert(a->end(), b.begin(), b.end());
    };
    join(&corner_px, o.corner_px);
    join(&position_mm, o.position_mm);
    join(&angle_deg, o.angle_deg);
    join(&nees, o.nees);
    join(&milliseconds, o.milliseconds);
  }
};

double middle(std::vector<double> values) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

constexpr double kRight_px = 5.0;  // a corner error beyond is a wrong picture or pose

void judge(const Wall& wall, const View& view, const simulator::Print& target,
           const slam::PictureSearch& search, bool verbose, Tally* tally) {
  const Transform T_c_w = view.T_w_c.inverse();
  ++tally->expected;
  tally->proposed += search.proposed;
  tally->refused += search.refused;
  for (const slam::FoundPicture& found : search.found) {
    const auto place = static_cast<std::size_t>(found.picture);
    const simulator::Print* print = place < wall.known.size() ? &wall.known[place] : nullptr;
    const Transform truth = print != nullptr ? T_c_w * print->T_w_p : Transform{};
    const slam::PictureAlignment& a = found.alignment;
    const double error_px =
        print != nullptr ? cornerError_px(*wall.camera, *print, a.T_c_p, truth) : 1e6;
    if (error_px > kRight_px) {
      ++tally->wrong;
      if (verbose) {
        std::printf("  wrong: picture %d, %g px, correlation %.3f, share %.2f of %d blocks\n",
                    found.picture, error_px, a.correlation, a.agreeing_share, a.textured_blocks);
      }
      continue;
    }
    const slam::Vector6d error = a.T_c_p.localCoordinates(truth);
    tally->nees.push_back(error.dot(a.covariance.ldlt().solve(error)));
    if (verbose && tally->nees.back() > 30.0) {
      std::printf(
          "  nees %.1f: %.3f px, ratio %.1f, noise %.2f, dependence %.2f, blur %.1f, %d px\n",
          tally->nees.back(), error_px, found.ambiguity_ratio, a.noise, a.dependence, a.blur_px,
          a.pixels);
    }
    if (print != &target) continue;
    ++tally->found;
    if (found.ambiguity_ratio < 3.0) ++tally->ambiguous;
    tally->corner_px.push_back(error_px);
    const Transform T_w_c = print->T_w_p * a.T_c_p.inverse();
    tally->position_mm.push_back(1000.0 * (T_w_c.p - view.T_w_c.p).norm());
    tally->angle_deg.push_back(slam::rotationDistance(T_w_c.R, view.T_w_c.R) / kRadPerDeg);
  }
}

std::optional<slam::FeatureKind> kindOf(const std::string& name) {
  if (name == "sift") return slam::FeatureKind::kSift;
  if (name == "brisk") return slam::FeatureKind::kBrisk;
  if (name == "akaze") return slam::FeatureKind::kAkaze;
  if (name == "orb") return slam::FeatureKind::kOrb;
  return std::nullopt;
}

// The first `count` pictures of the set; those that will not do are told.
std::vector<NaturalMarker> setOf(const Arguments& arguments, int count, slam::FeatureKind kind) {
  slam::NaturalMarkerOptions options;
  options.features.kind = kind;
  if (kind != slam::FeatureKind::kSift) options.min_distinct_features = 5;
  std::vector<NaturalMarker> markers;
  for (int i = 0; i < count; ++i) {
    const simulator::PosterImage poster = posterOf(arguments, static_cast<std::uint64_t>(i));
    auto marker = NaturalMarker::create(poster.view(), kWidth_m, 0.0, options);
    if (!marker) {
      std::printf("picture %d %s\n", i, marker.error().message.c_str());
      options.min_distinct_features = 0;
      options.max_repeated_share = 1.0;
      marker = NaturalMarker::create(poster.view(), kWidth_m, 0.0, options);
    }
    markers.push_back(std::move(*marker));
  }
  return markers;
}

void printHeader(const char* what) {
  std::printf("%-7s %-14s %5s %6s %5s %8s %8s %7s %8s %8s %6s %6s %7s\n", what, "condition",
              "views", "found", "wrong", "proposed", "corner", "90 %", "mm", "degrees", "NEES",
              "ambig", "ms");
}

void printRow(const std::string& what, const std::string& condition, const Tally& t) {
  std::vector<double> sorted = t.corner_px;
  std::sort(sorted.begin(), sorted.end());
  const double p90 = sorted.empty() ? 0.0 : sorted[sorted.size() * 9 / 10];
  std::printf("%-7s %-14s %5d %5.0f%% %5d %8d %8.3f %7.3f %8.2f %8.3f %6.2f %6d %7.1f\n",
              what.c_str(), condition.c_str(), t.expected,
              100.0 * t.found / std::max(1, t.expected), t.wrong, t.proposed, middle(t.corner_px),
              p90, middle(t.position_mm), middle(t.angle_deg), mean(t.nees), t.ambiguous,
              mean(t.milliseconds));
  std::fflush(stdout);
}

// Views of the first `targets` known posters.
Tally search(const Arguments& arguments, const Condition& condition, const Wall& wall,
             std::size_t targets, slam::PictureFinder* finder) {
  Tally tally;
  simulator::Random random(arguments.seed, 0x56494557);
  for (int i = 0; i < arguments.views; ++i) {
    const simulator::Print& target = wall.known[static_cast<std::size_t>(random.next() % targets)];
    const View view = render(wall, condition, target, static_cast<std::uint64_t>(i), &random);
    const ImageView image{view.pixels.data(), wall.camera->width(), wall.camera->height(),
                          wall.camera->width()};
    const std::int64_t before = threadCpuNs();
    const slam::PictureSearch found = finder->find(image, *wall.camera);
    tally.milliseconds.push_back(static_cast<double>(threadCpuNs() - before) / kNsPerMs);
    judge(wall, view, target, found, arguments.verbose, &tally);
  }
  return tally;
}

void compareKinds(const Arguments& arguments, const Wall& wall, const Wall& small) {
  for (const std::string& name : arguments.kinds) {
    const slam::FeatureKind kind = *kindOf(name);
    const std::vector<NaturalMarker> markers = setOf(arguments, kKnown, kind);
    slam::PictureFinderOptions options;
    options.features.kind = kind;
    slam::PictureFinder finder(markers, options);
    Tally all;
    printHeader("kind");
    for (const Condition& condition : conditions()) {
      const Tally tally =
          search(arguments, condition, condition.width == 640 ? wall : small, kKnown, &finder);
      printRow(name, condition.name, tally);
      all.add(tally);
    }
    printRow(name, "all", all);
  }
}

void compareNumbers(const Arguments& arguments, const Wall& wall) {
  if (arguments.numbers.empty()) return;
  const Condition ordinary{"0.3 to 3 m", 0.3, 3.0, 0.0, 50.0, 0.0, 0.0};
  const int most = *std::max_element(arguments.numbers.begin(), arguments.numbers.end());
  const std::vector<NaturalMarker> markers =
      setOf(arguments, std::max(most, kKnown), slam::FeatureKind::kSift);
  printHeader("known");
  for (const int number : arguments.numbers) {
    const std::int64_t before = threadCpuNs();
    slam::PictureFinder finder(
        std::span<const NaturalMarker>(markers).first(static_cast<std::size_t>(number)));
    const double index_ms = static_cast<double>(threadCpuNs() - before) / kNsPerMs;
    const auto targets = static_cast<std::size_t>(std::min(number, kKnown));
    printRow(std::to_string(number), ordinary.name,
             search(arguments, ordinary, wall, targets, &finder));
    std::printf("%-7d index made in %.0f ms\n", number, index_ms);
  }
}

tools::ExitCode run(Arguments arguments) {
  for (const std::string& name : arguments.kinds) {
    if (kindOf(name)) continue;
    std::fprintf(stderr, "natural_markers: '%s' is no kind of features\n", name.c_str());
    return tools::kBadInput;
  }
  cv::setNumThreads(1);
  if (!arguments.directory.empty()) {
    auto album = simulator::Album::open(arguments.directory, arguments.seed, kKnown + kStrange);
    if (!album) {
      std::fprintf(stderr, "natural_markers: %s\n", album.error().message.c_str());
      return tools::kBadInput;
    }
    for (int i = 0; i < kKnown + kStrange; ++i) arguments.photographs.push_back(album->next());
  }
  const Wall wall(arguments, 640);
  const Wall small(arguments, 320);
  compareKinds(arguments, wall, small);
  compareNumbers(arguments, wall);
  return tools::kDone;
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  bench::Arguments arguments;
  CLI::App app{"Pictures found on a wall: recall, errors, time", "natural_markers"};
  app.add_option("--views", arguments.views, "Of each condition")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", arguments.seed)->capture_default_str();
  app.add_option("--kinds", arguments.kinds, "sift, brisk, akaze, orb")->delimiter(',');
  app.add_option("--known", arguments.numbers, "How many pictures are known")
      ->delimiter(',')
      ->check(CLI::Range(1, 10'000));
  app.add_option("--photographs", arguments.directory,
                 "Photographs of this folder hang instead of made-up posters");
  app.add_flag("--verbose", arguments.verbose, "Each wrong one, each large error");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::run(std::move(arguments));
}
