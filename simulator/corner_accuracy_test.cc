// Is what the renderer draws where the truth says it is? Measured twice, by means that share
// nothing with the simulator: Debian's AprilTag detector, and the grey levels along the normals of
// the projected edges.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "base/image_view.h"
#include "simulator/projected_marker.h"
#include "simulator/simulation.h"
#include "simulator/testing/apriltag_detector.h"
#include "slam/geometry/plane.h"

namespace waymark::simulator {
namespace {

// Mean signed errors, pixels.
struct Bias {
  Eigen::Vector2d image = Eigen::Vector2d::Zero();  // along x and y
  double outward = 0.0;                             // from the marker's middle
  double square = 0.0;                              // mean squared distance
  int count = 0;

  void add(const Eigen::Vector2d& error, const Eigen::Vector2d& outwards) {
    image += error;
    outward += error.dot(outwards.normalized());
    square += error.squaredNorm();
    ++count;
  }
  void finish() {
    image /= count;
    outward /= count;
    square /= count;
  }
};

// A few frames of a scene, rendered.
struct Sequence {
  std::unique_ptr<const Simulation> simulation;
  std::vector<std::uint8_t> pixels;
  Simulation::Workspace workspace;

  ImageView render(std::int64_t frame) {
    const slam::Calibration& camera = simulation->camera();
    pixels.resize(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
    simulation->render(frame, &workspace, pixels.data());
    return {pixels.data(), camera.width, camera.height, camera.width};
  }
};

Sequence open(const Options& options) {
  auto simulation = Simulation::create(options, Ending::kOfTheScene);
  if (!simulation) {
    ADD_FAILURE() << simulation.error().message;
    return {};
  }
  return {std::move(*simulation), {}, {}};
}

Options aprilTags(const char* scene) {
  Options options;
  options.scene = scene;
  options.dictionary = "APRILTAG_36h11";
  return options;
}

Bias measure(const Options& options, int every) {
  Sequence sequence = open(options);
  const slam::CameraModel camera(sequence.simulation->camera());
  testing::AprilTagDetector detector;
  Bias bias;
  for (std::int64_t k = 0; k < sequence.simulation->frameCount(); k += every) {
    const std::map<int, ImageCorners> found = detector.detect(sequence.render(k));
    for (const Marker& marker : sequence.simulation->visibleMarkers(k)) {
      const ImageCorners truth =
          projectMarker(camera, sequence.simulation->poseAt(k), marker).value();
      if (shortestSide(truth) < 20.0) continue;
      const auto corners = found.find(marker.id);
      if (corners == found.end()) continue;
      for (std::size_t i = 0; i < 4; ++i) {
        bias.add(corners->second[i] - truth[i], truth[i] - slam::centreOf(truth));
      }
    }
  }
  bias.finish();
  return bias;
}

double bilinear(ImageView image, const Eigen::Vector2d& p) {
  const int x = static_cast<int>(std::floor(p.x()));
  const int y = static_cast<int>(std::floor(p.y()));
  const double fx = p.x() - x;
  const double fy = p.y() - y;
  return (1.0 - fy) * ((1.0 - fx) * image.at(x, y) + fx * image.at(x + 1, y)) +
         fy * ((1.0 - fx) * image.at(x, y + 1) + fx * image.at(x + 1, y + 1));
}

// How far outside the truth the edge through point `p_m` of a marker's outline lies, pixels. Along
// the line that crosses it, from half a cell inside (black) to half a cell outside (white), the
// area under the grey levels tells where the step is, whatever symmetric blur it has. `out_m` is
// the outward direction in the marker's plane, `along_m` the edge's. Empty where a cell is too
// small to have the blur die away within it.
std::optional<double> edgeOffset(ImageView image, const slam::CameraModel& camera,
                                 const slam::Transform& T_c_m, const Eigen::Vector3d& p_m,
                                 const Eigen::Vector3d& out_m, const Eigen::Vector3d& along_m,
                                 double cell_m) {
  const auto pixel = [&](const Eigen::Vector3d& q) { return *camera.project(T_c_m * q); };
  const Eigen::Vector2d edge = pixel(p_m);
  const Eigen::Vector2d along = (pixel(p_m + 0.1 * cell_m * along_m) - edge).normalized();
  const Eigen::Vector2d across =
      pixel(p_m + 0.1 * cell_m * out_m) - pixel(p_m - 0.1 * cell_m * out_m);
  const Eigen::Vector2d direction = across.normalized();
  const double to_perpendicular = std::abs(direction.x() * along.y() - direction.y() * along.x());
  const double reach = 0.5 * 5.0 * across.norm();  // half a cell
  constexpr double kBlurPx = 2.8;
  if (reach * to_perpendicular < kBlurPx) return std::nullopt;

  const double black = bilinear(image, edge - reach * direction);
  const double white = bilinear(image, edge + reach * direction);
  constexpr int kSteps = 400;
  double area = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double t = reach * (2.0 * (i + 0.5) / kSteps - 1.0);
    area += (bilinear(image, edge + t * direction) - black) * 2.0 * reach / kSteps;
  }
  return (reach - area / (white - black)) * to_perpendicular;
}

void print(const char* what, const Bias& bias) {
  std::printf("%s: %d corners, bias x %+.4f y %+.4f outward %+.4f, rms %.3f px\n", what, bias.count,
              bias.image.x(), bias.image.y(), bias.outward, std::sqrt(bias.square));
}

// Scenes whose markers are small in the image (20 to 50 px): AprilTag fits straight lines without
// knowing the lens, and across larger markers the lens bends the edges by tenths of a pixel (box:
// 0.05 px outwards).
TEST(CornerAccuracy, AprilTagFindsTheCornersWhereTheTruthHasThem) {
  for (const char* scene : {"walls", "ceiling"}) {
    const Bias bias = measure(aprilTags(scene), 60);
    print(scene, bias);
    EXPECT_GT(bias.count, 400);
    EXPECT_LT(std::abs(bias.image.x()), 0.02) << scene;
    EXPECT_LT(std::abs(bias.image.y()), 0.02) << scene;
    EXPECT_LT(std::abs(bias.outward), 0.02) << scene;
    EXPECT_LT(std::sqrt(bias.square), 0.15) << scene;
  }
}

// Along the true, curved edges, lens and all.
TEST(CornerAccuracy, EdgesLieWhereTheTruthHasThem) {
  Options options = aprilTags("box");
  options.noise_sigma = 0.0;
  Sequence sequence = open(options);
  const slam::CameraModel camera(sequence.simulation->camera());
  Bias bias;
  for (std::int64_t k = 0; k < sequence.simulation->frameCount(); k += 60) {
    const ImageView image = sequence.render(k);
    for (const Marker& marker : sequence.simulation->visibleMarkers(k)) {
      const slam::Transform T_c_m = sequence.simulation->poseAt(k).inverse() * marker.T_w_m;
      const double half = 0.5 * marker.size_m;
      for (int side = 0; side < 4; ++side) {
        const Eigen::Matrix3d turn = slam::expSo3({0.0, 0.0, 0.5 * std::numbers::pi * side});
        for (int step = -30; step <= 30; ++step) {
          const double s = 0.02 * step;
          const auto offset =
              edgeOffset(image, camera, T_c_m, turn * Eigen::Vector3d(half, s * half, 0.0),
                         turn.col(0), turn.col(1), marker.size_m / 8.0);
          if (!offset) continue;
          const Eigen::Vector2d out = *camera.project(T_c_m * (half * turn.col(0))) -
                                      *camera.project(T_c_m * Eigen::Vector3d::Zero());
          bias.add(*offset * out.normalized(), out);
        }
      }
    }
  }
  bias.finish();
  print("edges", bias);
  EXPECT_GT(bias.count, 5000);
  EXPECT_LT(std::abs(bias.image.x()), 0.003);
  EXPECT_LT(std::abs(bias.image.y()), 0.003);
  EXPECT_LT(std::abs(bias.outward), 0.005);
  EXPECT_LT(std::sqrt(bias.square), 0.05);
}

}  // namespace
}  // namespace waymark::simulator
