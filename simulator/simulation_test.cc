#include "simulator/simulation.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "simulator/simulated_source.h"

namespace waymark::simulator {
namespace {

using Image = std::vector<std::uint8_t>;

std::unique_ptr<const Simulation> make(const Options& options,
                                       Ending ending = Ending::kOfTheScene) {
  auto simulation = Simulation::create(options, ending);
  if (!simulation) {
    ADD_FAILURE() << simulation.error().message;
    return nullptr;
  }
  return std::move(*simulation);
}

Image render(const Simulation& simulation, std::int64_t frame) {
  Simulation::Workspace workspace;
  Image image(static_cast<std::size_t>(simulation.camera().width) *
              static_cast<std::size_t>(simulation.camera().height));
  simulation.render(frame, &workspace, image.data());
  return image;
}

double mean(const Image& image) {
  return std::accumulate(image.begin(), image.end(), 0.0) / static_cast<double>(image.size());
}

// Mean absolute difference, grey levels.
double difference(const Image& a, const Image& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(int{a[i]} - int{b[i]});
  return sum / static_cast<double>(a.size());
}

std::string reasonFor(const Options& options) {
  const auto simulation = Simulation::create(options, Ending::kOfTheScene);
  return simulation ? "" : simulation.error().message;
}

// Where markers are seen now and then only (scenes_test.cc says when), or never: those of a board
// for calibration are no map's.
bool hasGaps(const std::string& scene) {
  static const std::set<std::string> kGaps = {"building", "corridor",  "office",
                                              "trouble",  "table",     "table_fiducials",
                                              "board",    "chessboard"};
  return kGaps.contains(scene);
}

// Seen by the camera's geometry, without rendering.
TEST(Scenes, ShowAWholeMarkerInEveryFrame) {
  for (const SceneInfo& info : sceneList()) {
    if (hasGaps(info.name)) continue;
    for (const std::uint64_t seed : {1U, 2U, 3U}) {
      Options options;
      options.scene = info.name;
      options.seed = seed;
      options.size = ImageSize{64, 48};  // the field of view is what counts: quick to set up
      if (info.name == "lab") options.size = ImageSize{64, 36};
      if (info.name == "sheet") options.size = ImageSize{64, 36};
      const auto simulation = make(options);
      ASSERT_NE(simulation, nullptr);
      std::int64_t without = 0;
      std::size_t seen = 0;
      std::int64_t looked = 0;
      for (std::int64_t k = 0; k < simulation->frameCount(); k += 5) {
        const std::size_t visible = simulation->visibleMarkers(k).size();
        without += visible == 0 ? 1 : 0;
        seen += visible;
        ++looked;
      }
      EXPECT_EQ(without, 0) << info.name << " seed " << seed;
      const std::size_t usually = info.name == "dolly" ? 1 : 3;
      EXPECT_GT(seen, usually * static_cast<std::size_t>(looked)) << info.name;
    }
  }
}

TEST(Scenes, MoveSmoothlyAndNoFasterThanAPerson) {
  for (const SceneInfo& info : sceneList()) {
    Options options;
    options.scene = info.name;
    options.size = ImageSize{64, 48};
    const auto simulation = make(options);
    ASSERT_NE(simulation, nullptr);
    const double dt = 1.0 / simulation->scene().rate_hz;
    for (std::int64_t k = 1; k < simulation->frameCount(); ++k) {
      const slam::Transform a = simulation->poseAt(k - 1);
      const slam::Transform b = simulation->poseAt(k);
      ASSERT_LT((b.p - a.p).norm() / dt, 1.2) << info.name << " frame " << k;
      ASSERT_LT(slam::rotationDistance(a.R, b.R) / dt, 1.1) << info.name << " frame " << k;
      ASSERT_NEAR(b.R.determinant(), 1.0, 1e-9);
    }
  }
}

TEST(Scenes, CloseTheirLoopWhereAskedTo) {
  for (const SceneInfo& info : sceneList()) {
    Options options;
    options.scene = info.name;
    options.size = ImageSize{64, 48};
    options.duration_s = 8.0;
    const auto simulation = make(options, Ending::kClosedLoop);
    ASSERT_NE(simulation, nullptr);
    const Trajectory& pose = simulation->scene().trajectory;
    for (const double t : {0.0, 0.3, 5.0}) {
      EXPECT_LT((pose(t).p - pose(t + 8.0).p).norm(), 1e-9) << info.name;
      EXPECT_LT(slam::rotationDistance(pose(t).R, pose(t + 8.0).R), 1e-6) << info.name;
    }
  }
}

TEST(Scenes, RevisitEndsAtTheFirstViewFromFartherAway) {
  Options options;
  options.scene = "revisit";
  const auto simulation = make(options);
  const slam::Transform first = simulation->poseAt(0);
  const slam::Transform last = simulation->scene().trajectory(simulation->scene().duration_s);
  EXPECT_NEAR((last.p - first.p).norm(), 1.7, 0.01);
  EXPECT_LT(slam::rotationDistance(first.R, last.R), 0.01);
}

TEST(Simulation, SaysWhatIsWrong) {
  Options options;
  options.scene = "moon";
  EXPECT_NE(reasonFor(options).find("unknown scene 'moon'; there are walls, ceiling"),
            std::string::npos);
  options = {};
  options.dictionary = "8X8_50";
  EXPECT_EQ(reasonFor(options), "unknown dictionary '8X8_50'");
  options.dictionary = "APRILTAG_16h5";
  EXPECT_EQ(reasonFor(options), "scene walls needs 48 markers, but APRILTAG_16h5 has only 30");
  options = {};
  options.marker_size_m = 0.0;
  EXPECT_EQ(reasonFor(options), "marker size must be 0.001 to 10 metres");
  options = {};
  options.noise_sigma = std::nan("");
  EXPECT_EQ(reasonFor(options), "noise sigma must be 0 to 100 grey levels");
  options = {};
  options.doubled_id = 48;
  EXPECT_EQ(reasonFor(options), "no marker 48 to print twice: the scene's ids are 0 to 47");
  options = {};
  options.blackouts = {{2.0, 1.0}};
  EXPECT_EQ(reasonFor(options), "a blackout must begin before it ends");
}

TEST(Simulation, RendersTheSameFrameInAnyOrder) {
  Options options;
  options.exposure_s = 0.01;
  options.exposure_samples = 2;
  options.readout_s = 0.02;
  const auto simulation = make(options);
  const auto again = make(options);
  const Image first = render(*simulation, 40);
  render(*simulation, 7);
  EXPECT_EQ(first, render(*simulation, 40));
  EXPECT_EQ(first, render(*again, 40));
  options.seed = 2;
  EXPECT_NE(first, render(*make(options), 40));
}

TEST(Simulation, NoiseHasItsSigmaAndDiffersFromFrameToFrame) {
  Options options;
  options.noise_sigma = 0.0;
  const Image clean = render(*make(options), 3);
  options.noise_sigma = 3.0;
  const Image noisy = render(*make(options), 3);
  double sum = 0.0;
  double square = 0.0;
  for (std::size_t i = 0; i < clean.size(); ++i) {
    const double d = static_cast<double>(noisy[i]) - clean[i];
    sum += d;
    square += d * d;
  }
  const auto n = static_cast<double>(clean.size());
  EXPECT_NEAR(sum / n, 0.0, 0.03);
  EXPECT_NEAR(std::sqrt(square / n), 3.0, 0.1);
}

TEST(Simulation, BlackoutsAndDimmingTakeTheLight) {
  Options options;
  options.duration_s = 1.0;
  options.noise_sigma = 0.0;
  options.vignetting = 0.0;
  const Image full = render(*make(options), 30);  // at 0.5 s
  options.dimmings = {{{0.4, 0.6}, 0.5}};
  EXPECT_NEAR(mean(render(*make(options), 30)), 0.5 * mean(full), 0.5);
  options.blackouts = {{0.4, 0.6}};
  const auto simulation = make(options);
  EXPECT_EQ(mean(render(*simulation, 30)), 0.0);
  EXPECT_GT(mean(render(*simulation, 36)), 50.0);  // 0.6 s: over
}

TEST(Simulation, MovesTheMarkerWhenItSaysSo) {
  Options options;
  options.duration_s = 1.0;
  options.noise_sigma = 0.0;
  const auto still = make(options);
  const Marker seen = still->visibleMarkers(30).front();
  options.moved_marker = MovedMarker{seen.id, 0.5, {0.0, 0.0, 0.3}};
  const auto moving = make(options);
  EXPECT_EQ(render(*still, 29), render(*moving, 29));
  EXPECT_NE(render(*still, 30), render(*moving, 30));
  const auto at = [&](std::int64_t frame) {
    for (const Marker& marker : moving->markersAt(frame)) {
      if (marker.id == seen.id) return marker.T_w_m.p;
    }
    return Eigen::Vector3d(Eigen::Vector3d::Zero());
  };
  EXPECT_LT((at(30) - at(29) - Eigen::Vector3d(0.0, 0.0, 0.3)).norm(), 1e-12);
}

TEST(Simulation, PrintsAnIdTwice) {
  Options options;
  options.doubled_id = 20;
  const auto simulation = make(options);
  const auto plain = make(Options{});
  std::vector<slam::Transform> places;
  for (const Marker& marker : simulation->markers()) {
    if (marker.id == 20) places.push_back(marker.T_w_m);
  }
  ASSERT_EQ(places.size(), 2U);
  EXPECT_EQ(places[0].p, plain->markers()[20].T_w_m.p);  // the original first
  EXPECT_GT((places[1].p - places[0].p).norm(), 2.0);
  EXPECT_EQ(simulation->markers().size(), plain->markers().size());
}

// Rows are exposed one after the other: each row of the rolling image is that row of a global
// image taken at the row's own time.
TEST(Simulation, RollingShutterReadsRowsInTurn) {
  Options options;
  options.noise_sigma = 0.0;
  options.psf_sigma_px = 0.0;
  options.rate_hz = 958.0;  // two frames to a row of the readout below, so that rows meet frames
  options.duration_s = 2.0;
  const auto global = make(options);
  options.readout_s = 1.0;
  const auto rolling = make(options);
  const std::int64_t middle = 800;
  const Image image = render(*rolling, middle);
  for (const std::ptrdiff_t row : {0, 100, 239, 240, 420, 479}) {
    const Image snapshot = render(*global, middle + 2 * row - 479);
    int largest = 0;
    for (std::ptrdiff_t i = row * 640; i < (row + 1) * 640; ++i) {
      const auto at = static_cast<std::size_t>(i);
      largest = std::max(largest, std::abs(int{image[at]} - int{snapshot[at]}));
    }
    EXPECT_LE(largest, 1) << "row " << row;
  }
  EXPECT_GT(difference(image, render(*global, middle)), 5.0);
}

// The exposure is centred on the stamp: blurred and sharp images agree about where things are.
TEST(Simulation, MotionBlurIsCentredOnTheStamp) {
  Options options;
  options.noise_sigma = 0.0;
  const auto sharp = make(options);
  options.exposure_s = 1.0 / 30.0;
  options.exposure_samples = 16;
  const auto blurred = make(options);
  const std::int64_t k = 300;
  const Image image = render(*blurred, k);
  const double now = difference(image, render(*sharp, k));
  const double before = difference(image, render(*sharp, k - 1));
  const double after = difference(image, render(*sharp, k + 1));
  EXPECT_LT(now, 0.8 * before);
  EXPECT_LT(now, 0.8 * after);
  EXPECT_NEAR(before / after, 1.0, 0.1);
}

TEST(SimulatedSource, HandsOutEveryFrameWithItsTime) {
  Options options;
  options.duration_s = 0.05;
  auto source = openSimulation(options);
  ASSERT_TRUE(source.ok());
  EXPECT_EQ((*source)->info().frame_count, 3);
  EXPECT_FALSE((*source)->info().live);
  for (std::uint64_t k = 0; k < 3; ++k) {
    auto result = (*source)->read(std::chrono::milliseconds(0));
    auto* const frame = std::get_if<capture::FramePtr>(&result);
    ASSERT_NE(frame, nullptr);
    EXPECT_EQ((*frame)->stamp().sequence, k);
    EXPECT_EQ((*frame)->stamp().monotonic_ns, std::llround(static_cast<double>(k) * 1e9 / 60.0));
    EXPECT_EQ((*frame)->image().width, 640);
  }
  EXPECT_TRUE(
      std::holds_alternative<capture::EndOfStream>((*source)->read(std::chrono::milliseconds(0))));
  EXPECT_EQ((*source)->counters().frames, 3U);
}

}  // namespace
}  // namespace waymark::simulator
