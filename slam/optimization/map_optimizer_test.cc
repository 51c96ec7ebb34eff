#include "slam/optimization/map_optimizer.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"
#include "slam/testing/whole_map_fit.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;
const BundleOptions kToTheEnd{.max_iterations = 100, .min_relative_decrease = 1e-10};

// A walk along a wall of twelve markers: keyframes at its ends share none.
class MapOptimizerTest : public ::testing::Test {
 protected:
  MapOptimizerTest() {
    for (int i = 0; i < 12; ++i) {
      const double x = 0.4 * i;
      views_.push_back(
          testing::lookAt({x, 0.3 * (i % 3), 0.2 * (i % 2)}, {x + 0.1 * (i % 2), 2.0, 0.0}));
      std::uniform_real_distribution<double> u(-0.6, 0.6);
      const Eigen::Vector3d centre(x, 2.0, 0.2 * u(rng_));
      markers_.push_back(
          {i, testing::markerFacing(centre, centre + Eigen::Vector3d(u(rng_), -1.0, u(rng_)))});
    }
    options_.size_m = kSize;
  }

  Map trueMap(double sigma_px) {
    return testing::trueMap(camera_, views_, markers_, kSize, sigma_px, &rng_);
  }

  // Everything a little off, but the first keyframe.
  void disturb(Map* map, double sigma = 0.01) {
    for (const auto& [id, keyframe] : map->keyframes()) {
      if (id > 0) map->setKeyframePose(id, testing::disturbed(keyframe.T_w_c, sigma, &rng_));
    }
    for (const auto& [id, marker] : map->markers()) {
      map->place(id, testing::disturbed(*marker.T_w_m, sigma, &rng_));
    }
  }

  [[nodiscard]] double largestError(const Map& map) const {
    double largest = 0.0;
    for (const auto& marker : markers_) {
      const MapMarker* found = map.findPosed(marker.id);
      if (found != nullptr) {
        largest = std::max(largest, (found->T_w_m->p - marker.T_w_m.p).norm());
      }
    }
    return largest;
  }

  std::mt19937 rng_{31};
  CameraModel camera_{testing::testCalibration()};
  std::vector<Transform> views_;
  std::vector<testing::SyntheticMarker> markers_;
  MarkerOptions options_;
};

bool same(const Transform& a, const Transform& b) { return a.p == b.p && a.R == b.R; }

TEST_F(MapOptimizerTest, GloballyTheFirstKeyframeIsTheWorld) {
  Map map = trueMap(0.0);
  disturb(&map);
  const Map before = map;
  const BundleSummary summary = optimizeGlobally(&map, options_, kToTheEnd);
  EXPECT_FALSE(summary.failed);
  EXPECT_TRUE(same(map.keyframes().at(0).T_w_c, before.keyframes().at(0).T_w_c));
  EXPECT_GT(largestError(before), 0.01);
  EXPECT_LT(largestError(map), 1e-5);
}

TEST_F(MapOptimizerTest, GloballyTheOriginMarkerIsTheWorld) {
  Map map = trueMap(0.0);
  map.moveWorld(map.find(5)->T_w_m->inverse());
  disturb(&map);
  map.place(5, Transform{});
  options_.origin_marker = 5;
  (void)optimizeGlobally(&map, options_, kToTheEnd);
  EXPECT_TRUE(same(*map.find(5)->T_w_m, Transform{}));
  EXPECT_FALSE(same(map.keyframes().at(0).T_w_c, views_[0]));
  const Transform T_o_w = markers_[5].T_w_m.inverse();
  for (const auto& marker : markers_) {
    EXPECT_LT((map.find(marker.id)->T_w_m->p - (T_o_w * marker.T_w_m).p).norm(), 1e-5);
  }
}

// The whole map was in a world a little off; the surveyed ends pull it into theirs.
TEST_F(MapOptimizerTest, GloballyAnchorsPullTheMapIntoTheirWorld) {
  Map map = trueMap(0.0);
  map.moveWorld(testing::disturbed(Transform{}, 0.05, &rng_));
  options_.anchors = {{0, markers_[0].T_w_m}, {11, markers_[11].T_w_m}};
  ASSERT_GT(largestError(map), 0.05);
  (void)optimizeGlobally(&map, options_, kToTheEnd);
  EXPECT_LT(largestError(map), 1e-4);
}

// Of section 4.7: neighbours move, those that only share a neighbour's markers hold them, and what
// is far away is not touched.
TEST_F(MapOptimizerTest, LocallyWhatIsFarStaysBitIdentical) {
  Map map = trueMap(0.0);
  disturb(&map, 0.003);
  const Map before = map;
  const std::vector<KeyframeId> near = map.neighbours(11);
  ASSERT_LT(near.size(), 8U);
  (void)optimizeLocally(&map, 11, options_, kToTheEnd);
  for (const auto& [id, keyframe] : map.keyframes()) {
    const bool neighbour = std::find(near.begin(), near.end(), id) != near.end();
    EXPECT_EQ(same(keyframe.T_w_c, before.keyframes().at(id).T_w_c), !neighbour) << id;
  }
  const std::vector<int> seen = map.markersSeenFrom(near);
  for (const auto& [id, marker] : map.markers()) {
    const bool moves = std::find(seen.begin(), seen.end(), id) != seen.end();
    EXPECT_EQ(same(*marker.T_w_m, *before.find(id)->T_w_m), !moves) << id;
  }
}

TEST_F(MapOptimizerTest, MarkersLearnHowWellTheyAreKnown) {
  Map map = trueMap(0.1);
  (void)optimizeGlobally(&map, options_, kToTheEnd);
  for (const auto& [id, marker] : map.markers()) {
    const double sigma_m = std::sqrt(marker.covariance.topLeftCorner<3, 3>().trace());
    // A tenth of a pixel at 2 m is 0.4 mm sideways; in depth some 3 m * 0.1 / (100 pixels wide).
    EXPECT_GT(sigma_m, 1e-4);
    EXPECT_LT(sigma_m, 1e-2);
  }
}

TEST_F(MapOptimizerTest, FitTellsCostNoiseAndCorners) {
  Map map = trueMap(0.0);
  const MapFit fit = testing::wholeMapFit(map);
  EXPECT_LT(testing::costOf(fit), 1e-9);
  EXPECT_EQ(fit.residual_sigma, 1.0) << "never less than the covariances say";
  std::size_t corners = 0;
  for (const auto& [id, keyframe] : map.keyframes()) {
    corners += 4 * keyframe.detections.size();
  }
  EXPECT_EQ(fit.squared.size(), corners);
  // Noise four times what the covariances say.
  map = trueMap(0.2);
  const Map honest = map;
  for (const auto& [id, keyframe] : honest.keyframes()) {
    Keyframe noisy = keyframe;
    map.removeKeyframe(id);
    noisy.detections.change([](auto* detections) {
      for (auto& detection : *detections) {
        for (auto& covariance : detection.covariance) covariance /= 16.0;
      }
    });
    (void)map.addKeyframe(noisy);
  }
  EXPECT_NEAR(testing::wholeMapFit(map).residual_sigma, 4.0, 0.6);
  Transform behind = *map.find(3)->T_w_m;
  behind.p.y() = -9.0;
  map.place(3, behind);
  EXPECT_TRUE(std::isinf(testing::costOf(testing::wholeMapFit(map))));
}

TEST_F(MapOptimizerTest, OutlierViewsLeaveTheMap) {
  Map map = trueMap(0.05);
  const KeyframeId seen_by = map.viewsOf(5)[1];
  testing::displaceView(seen_by, 5, 20.0 / camera_.focalLength(), &map);
  const std::size_t views = map.viewsOf(5).size();
  const BundleSummary summary = optimizeGlobally(&map, options_, kToTheEnd);
  EXPECT_EQ(summary.gated_views, 1);
  EXPECT_EQ(map.viewsOf(5).size(), views - 1);
  EXPECT_EQ(map.keyframes().at(seen_by).find(5), nullptr);
}

// Cut into slices of any size, it is the same optimization.
TEST_F(MapOptimizerTest, SlicesChangeNothing) {
  Map whole = trueMap(0.05);
  disturb(&whole);
  Map sliced = whole;
  (void)optimizeGlobally(&whole, options_, kToTheEnd);
  SlicedTask<MapCorrection> task([&](Budget* a) {
    return optimizeSubproblem(sliced, wholeMap(sliced), options_, kToTheEnd, a);
  });
  int slices = 1;
  while (!task.advance(5.0)) ++slices;
  EXPECT_GT(slices, 20);
  ASSERT_TRUE(apply(task.take(), &sliced));
  for (const auto& [id, marker] : whole.markers()) {
    EXPECT_EQ(marker.T_w_m->p, sliced.find(id)->T_w_m->p);
    EXPECT_EQ(marker.covariance, sliced.find(id)->covariance);
  }
}

// While an optimization is under way, the map goes on living.
TEST_F(MapOptimizerTest, ACorrectionMeetsTheMapAsItIsByThen) {
  Map map = trueMap(0.05);
  disturb(&map);
  SlicedTask<MapCorrection> task(
      [&](Budget* a) { return optimizeSubproblem(map, wholeMap(map), options_, kToTheEnd, a); });
  ASSERT_FALSE(task.advance(5.0));
  map.removeKeyframe(4);
  map.removeKeyframe(11);
  // Marker 3 was quarantined and hangs somewhere else; marker 5 has no pose any more.
  const Transform elsewhere = testing::lookAt({9.0, 9.0, 9.0}, {0.0, 0.0, 0.0});
  map.quarantine(3);
  map.place(3, elsewhere);
  map.quarantine(5);
  const Keyframe late = map.keyframes().at(map.addKeyframe({-1, 0, 0, elsewhere, {}}));
  while (!task.advance(5.0)) {
  }
  ASSERT_TRUE(apply(task.take(), &map));
  EXPECT_EQ(map.find(3)->T_w_m->p, elsewhere.p);
  EXPECT_FALSE(map.find(5)->T_w_m);
  EXPECT_EQ(map.keyframes().at(late.id).T_w_c.p, elsewhere.p);
  EXPECT_FALSE(map.keyframes().contains(4));
  EXPECT_LT((map.find(7)->T_w_m->p - markers_[7].T_w_m.p).norm(), 0.01)
      << "the others are put right";
}

TEST_F(MapOptimizerTest, ACorrectionOfOtherCoordinatesIsOfNoUse) {
  Map map = trueMap(0.05);
  SlicedTask<MapCorrection> task(
      [&](Budget* a) { return optimizeSubproblem(map, wholeMap(map), options_, kToTheEnd, a); });
  ASSERT_FALSE(task.advance(5.0));
  map.moveWorld({expSo3({0.0, 0.0, 1.0}), {1.0, 2.0, 3.0}});
  const Map moved = map;
  while (!task.advance(5.0)) {
  }
  EXPECT_FALSE(apply(task.take(), &map));
  EXPECT_EQ(map.find(7)->T_w_m->p, moved.find(7)->T_w_m->p);
}

// Given its views, as sure as the optimization says.
TEST_F(MapOptimizerTest, ANewMarkersCovarianceIsThatOfItsViews) {
  Map map = trueMap(0.05);
  const BundleSummary summary = optimizeGlobally(&map, options_, kToTheEnd);
  const Matrix6d& together = map.find(3)->covariance;
  const Transform& T_w_m = *map.find(3)->T_w_m;
  const Matrix6d alone = markerCovariance(map, 3, T_w_m, summary.residual_sigma);
  EXPECT_LT((alone - together).norm(), 0.1 * together.norm());
  EXPECT_LT((markerCovariance(map, 3, T_w_m, 2.0 * summary.residual_sigma) - 4.0 * alone).norm(),
            1e-9 * together.norm());
}

TEST_F(MapOptimizerTest, EmptyMapsDoNoHarm) {
  Map empty;
  EXPECT_EQ(optimizeGlobally(&empty, options_, kToTheEnd).final_cost, 0.0);
  EXPECT_EQ(testing::wholeMapFit(empty).squared.size(), 0U);
  Map unposed;
  unposed.addMarker(1, kSize);
  MarkerDetection detection;
  detection.id = 1;
  (void)unposed.addKeyframe({-1, 0, 0, {}, {detection}});
  EXPECT_EQ(optimizeGlobally(&unposed, options_, kToTheEnd).final_cost, 0.0);
  EXPECT_EQ(optimizeLocally(&unposed, 0, options_, kToTheEnd).final_cost, 0.0);
  EXPECT_FALSE(unposed.find(1)->T_w_m);
}

}  // namespace
}  // namespace waymark::slam
