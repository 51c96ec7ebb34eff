#include "slam/covariance/marginal_recovery.h"

#include <cmath>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "slam/camera/undistort_map.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/testing/dense_system.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

// Of the position.
double variance_m2(const Matrix6d& covariance) { return covariance.topLeftCorner<3, 3>().trace(); }

constexpr double kSize_m = 0.2;
constexpr double kSigma_px = 0.1;

// Somebody turns round in a room of 28 markers.
class MarginalRecoveryTest : public ::testing::Test {
 protected:
  MarginalRecoveryTest()
      : markers_(testing::roomMarkers(28, 2.5, &rng_)),
        map_(testing::trueMap(camera_, testing::roomViews(0.0, 5.5, 24), markers_, kSize_m,
                              kSigma_px, &rng_)) {}

  [[nodiscard]] MapMarginals recovered(double residual_sigma = 1.0) const {
    return runToCompletion([&](Budget* a) {
      return recoverMarginals(map_, options_, uncertainty_, residual_sigma, a);
    });
  }

  void optimize() {
    (void)optimizeGlobally(&map_, options_, {.max_iterations = 50, .min_relative_decrease = 1e-12});
  }

  // None is weighted down, and none left out.
  void optimizeAllViews() {
    (void)optimizeGlobally(&map_, options_,
                           {.max_iterations = 50,
                            .min_relative_decrease = 1e-14,
                            .huber = 1e6,
                            .estimate_residual_sigma = false,
                            .view_chi2 = 0.0});
  }

  // Of all the normal equations at once.
  struct Dense {
    Eigen::MatrixXd inverse;
    Eigen::VectorXd step;  // to the best map; a kernel pulls
    std::vector<int> row;  // the first one of each marker, -1 where it is fixed
  };
  [[nodiscard]] Dense solveDensely() const {
    constexpr double kKernel = 2.45;
    const testing::DenseSystem system = testing::denseSystem(map_, options_, kKernel);
    const Eigen::MatrixXd inverse = system.H.inverse();
    return {inverse, -inverse * system.g, system.row};
  }

  void expectAsDense(double relative_tolerance) const {
    const Dense dense = solveDensely();
    const std::vector<int>& row = dense.row;
    const MapMarginals marginals = recovered();
    ASSERT_EQ(marginals.markers().size(), markers_.size());
    int pairs = 0;
    for (std::size_t a = 0; a < markers_.size(); ++a) {
      if (row[a] < 0) continue;
      for (std::size_t b = 0; b < markers_.size(); ++b) {
        if (row[b] < 0) continue;
        const auto block = marginals.between(static_cast<int>(a), static_cast<int>(b));
        if (!block) continue;
        ++pairs;
        const Matrix6d expected =
            dense.inverse.block<6, 6>(row[a], row[b]) +
            dense.step.segment<6>(row[a]) * dense.step.segment<6>(row[b]).transpose();
        const double size = std::sqrt(marginals.find(static_cast<int>(a))->norm() *
                                      marginals.find(static_cast<int>(b))->norm());
        EXPECT_LE((*block - expected).norm(), relative_tolerance * size) << a << " and " << b;
      }
    }
    EXPECT_GT(pairs, 25);
  }

  std::mt19937 rng_{7};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_;
  Map map_;
  MarkerOptions options_;
  CameraUncertainty uncertainty_{.camera = &camera_};
};

// How far the map is from its best goes in squared: here it is at the truth.
TEST_F(MarginalRecoveryTest, IsTheInverseOfAllNormalEquations) {
  expectAsDense(1e-4);
  const double at_truth = variance_m2(*recovered().find(20));
  optimize();
  expectAsDense(1e-4);
  EXPECT_LT(variance_m2(*recovered().find(20)), 0.999 * at_truth);
  EXPECT_LT(solveDensely().step.norm(), 1e-3);
}

TEST_F(MarginalRecoveryTest, AnOriginMarkerIsTheWorld) {
  options_.origin_marker = 3;
  expectAsDense(1e-4);
  EXPECT_TRUE(recovered().find(3)->isZero(0.0));
}

TEST_F(MarginalRecoveryTest, AnAnchoredMarkerIsAsSureAsItsAnchor) {
  options_.anchors = {{.id = 5, .T_w_m = markers_[5].T_w_m, .sigma_m = 0.01, .sigma_rad = 0.02}};
  optimize();
  const MapMarginals marginals = recovered();
  EXPECT_NEAR((*marginals.find(5))(0, 0), 1e-4, 1e-6);
  EXPECT_NEAR((*marginals.find(5))(4, 4), 4e-4, 4e-6);
}

// Farther from the first keyframe, nobody knows better.
TEST_F(MarginalRecoveryTest, DoubtGrowsWithTheWay) {
  const MapMarginals marginals = recovered();
  EXPECT_GT(variance_m2(*marginals.find(20)), 3.0 * variance_m2(*marginals.find(0)));
}

TEST_F(MarginalRecoveryTest, GrowsWithTheNoise) {
  optimize();
  const MapMarginals once = recovered();
  const MapMarginals twice = recovered(2.0);
  EXPECT_LT((*twice.find(4) - 4.0 * *once.find(4)).norm(), 1e-3 * twice.find(4)->norm());
}

// A camera that turns and goes sideways, of which one parameter after the other is another one: the
// map of the same images is where the marginals say.
TEST_F(MarginalRecoveryTest, KnowsHowTheMapMovesWithTheCamera) {
  map_ = testing::trueMap(camera_, testing::roomViews(0.0, 5.5, 24), markers_, kSize_m, 0.0, &rng_);
  for (const auto& [id, keyframe] : map_.keyframes()) {
    Twist twist;
    twist << 0.3, 0.05 * static_cast<double>(id % 3), -0.1, 0.05, 0.4, 0.1;
    map_.setKeyframeTwist(id, twist);
  }
  undistortAgain(camera_, 0.0, &map_);
  optimizeAllViews();
  GlobalVector step;
  step << 0.02, 0.02, 0.02, 0.02, 1e-4, 1e-4, 1e-5, 1e-5, 1e-4, 1e-3;
  uncertainty_.covariance = GlobalMatrix::Identity();
  const MapMarginals marginals = recovered();
  const Map before = map_;
  for (int i = 0; i < BundleProblem::kGlobals; ++i) {
    map_ = before;
    IntrinsicVector intrinsics = camera_.intrinsics();
    if (i < 9) intrinsics[i] += step[i];
    undistortAgain(CameraModel(camera_.withIntrinsics(intrinsics)), i < 9 ? 0.0 : step[i], &map_);
    optimizeAllViews();
    for (const int id : {4, 12, 20}) {
      const Vector6d moved = before.find(id)->T_w_m->localCoordinates(*map_.find(id)->T_w_m);
      const Vector6d expected = step[i] * marginals.byCamera(id)->col(i);
      EXPECT_GT(moved.norm(), 1e-5) << "parameter " << i << ", marker " << id;
      EXPECT_LT((moved - expected).norm(), 0.05 * moved.norm())
          << "parameter " << i << ", marker " << id;
    }
  }
}

TEST_F(MarginalRecoveryTest, OfAKnownCameraNothingMoves) {
  EXPECT_EQ(recovered().byCamera(4), nullptr);
  uncertainty_.covariance(9, 9) = 1e-4;  // only the readout time
  const MapMarginals marginals = recovered();
  ASSERT_NE(marginals.byCamera(4), nullptr);
  EXPECT_TRUE(marginals.byCamera(4)->leftCols<9>().isZero(0.0));
}

TEST_F(MarginalRecoveryTest, KnowsWhatMarkersSeenTogetherHaveInCommon) {
  const MapMarginals marginals = recovered();
  ASSERT_TRUE(marginals.between(4, 5));
  EXPECT_EQ(*marginals.between(4, 5), marginals.between(5, 4)->transpose());
  EXPECT_FALSE(marginals.between(0, 14)) << "opposite each other, and never in one view";
}

TEST_F(MarginalRecoveryTest, SlicesChangeNothing) {
  const MapMarginals at_once = recovered();
  SlicedTask<MapMarginals> task(
      [&](Budget* a) { return recoverMarginals(map_, options_, uncertainty_, 1.0, a); });
  int slices = 1;
  while (!task.advance(5.0)) ++slices;
  EXPECT_GT(slices, 5);
  const MapMarginals sliced = task.take();
  EXPECT_EQ(sliced.markers(), at_once.markers());
  EXPECT_EQ(*sliced.between(4, 5), *at_once.between(4, 5));
}

// Keyframes come and go, and views with them, while the work is under way.
TEST_F(MarginalRecoveryTest, TheMapMayChangeMeanwhile) {
  SlicedTask<MapMarginals> task(
      [&](Budget* a) { return recoverMarginals(map_, options_, uncertainty_, 1.0, a); });
  bool added = false;
  while (!task.advance(5.0)) {
    if (map_.keyframes().size() > 8 && map_.keyframes().rbegin()->first > 4) {
      map_.removeKeyframe(map_.keyframes().rbegin()->first);
    }
    if (std::exchange(added, true)) continue;
    Keyframe everything = map_.keyframes().begin()->second;
    everything.id = -1;
    for (int id = 6; id < 10; ++id) {
      MarkerDetection another = everything.detections.front();
      another.id = id;
      everything.detections.push_back(another);
    }
    (void)map_.addKeyframe(everything);
  }
  const MapMarginals marginals = task.take();
  for (const auto& [id, covariance] : marginals.markers()) {
    EXPECT_GT(covariance.diagonal().minCoeff(), 0.0) << id;
  }
}

// Of an imported map, with markers but no views.
TEST_F(MarginalRecoveryTest, MarkersThatNobodySeesKeepWhatTheMapSays) {
  Map imported;
  imported.addMarker(1, kSize_m);
  imported.place(1, markers_[1].T_w_m, {}, 1e-4 * Matrix6d::Identity());
  const MapMarginals marginals = runToCompletion(
      [&](Budget* a) { return recoverMarginals(imported, options_, uncertainty_, 1.0, a); });
  ASSERT_NE(marginals.find(1), nullptr);
  EXPECT_EQ(*marginals.find(1), 1e-4 * Matrix6d::Identity());
  EXPECT_EQ(marginals.find(2), nullptr);
}

// A marker carried across the room.
TEST_F(MarginalRecoveryTest, LinksCount) {
  const MapMarginals without = recovered();
  const Keyframe& last = map_.keyframes().rbegin()->second;
  ASSERT_EQ(last.find(1), nullptr);
  Matrix6d covariance = 1e-6 * Matrix6d::Identity();
  covariance(0, 4) = covariance(4, 0) = 5e-7;
  map_.addLink(last.id, {1, last.T_w_c.inverse() * *map_.find(1)->T_w_m, covariance});
  optimize();
  expectAsDense(1e-4);
  const int far = last.detections.begin()->id;
  EXPECT_LT(recovered().find(far)->trace(), 0.9 * without.find(far)->trace()) << "it closes a loop";
}

// Recoveries that keep what they have linearized, and one that does not.
class KeptInformationTest : public MarginalRecoveryTest {
 protected:
  MapMarginals recoveredWithKept(double residual_sigma = 1.0) {
    return runToCompletion([&](Budget* a) {
      return recoverMarginals(map_, options_, uncertainty_, residual_sigma, a, &kept_);
    });
  }

  // Of a recovery: how many keyframes it linearizes.
  std::size_t linearizedNow(double residual_sigma = 1.0) {
    const std::size_t before = kept_.kept();
    (void)recoveredWithKept(residual_sigma);
    return kept_.kept() - before;
  }

  void expectAsWithoutKept(double relative_tolerance) {
    const MapMarginals with = recoveredWithKept();
    const MapMarginals without = recovered();
    ASSERT_EQ(with.markers().size(), without.markers().size());
    for (const auto& [a, covariance] : without.markers()) {
      for (const auto& [b, other] : without.markers()) {
        const auto expected = without.between(a, b);
        const auto block = with.between(a, b);
        ASSERT_EQ(block.has_value(), expected.has_value()) << a << " and " << b;
        if (!block) continue;
        const double size = std::sqrt(covariance.norm() * other.norm());
        EXPECT_LE((*block - *expected).norm(), relative_tolerance * size) << a << " and " << b;
      }
    }
  }

  // One in the middle, and a marker that it sees.
  [[nodiscard]] KeyframeId someKeyframe() const { return 12; }
  [[nodiscard]] int someMarker() const {
    return map_.keyframes().at(someKeyframe()).detections.front().id;
  }
  void displace(int marker, double by_m) {
    Transform T_w_m = *map_.find(marker)->T_w_m;
    T_w_m.p.x() += by_m;
    map_.place(marker, T_w_m);
  }

  KeptInformation kept_;
};

TEST_F(KeptInformationTest, WhereNothingChangesNothingIsLinearizedAnew) {
  EXPECT_EQ(linearizedNow(), map_.keyframes().size());
  EXPECT_EQ(linearizedNow(), 0U);
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, AnotherKeyframeIsAddedToWhatIsKept) {
  (void)recoveredWithKept();
  Keyframe another = map_.keyframes().at(someKeyframe());
  another.id = -1;
  (void)map_.addKeyframe(another);
  EXPECT_EQ(linearizedNow(), 1U);
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, AKeyframeThatIsGoneSaysNothing) {
  (void)recoveredWithKept();
  const std::size_t bytes = kept_.bytes();
  map_.removeKeyframe(someKeyframe());
  EXPECT_EQ(linearizedNow(), 0U);
  EXPECT_EQ(kept_.size(), map_.keyframes().size());
  EXPECT_LT(kept_.bytes(), bytes);
  expectAsWithoutKept(1e-9);
}

// The next one holds the world then.
TEST_F(KeptInformationTest, TheFirstKeyframesSuccessorIsLinearizedAnew) {
  (void)recoveredWithKept();
  map_.removeKeyframe(map_.keyframes().begin()->first);
  EXPECT_EQ(linearizedNow(), 1U);
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, AKeyframeThatMovesIsLinearizedAnew) {
  (void)recoveredWithKept();
  Transform T_w_c = map_.keyframes().at(someKeyframe()).T_w_c;
  T_w_c.p.y() += 1.1 * kStillLinear_sides * kSize_m;
  map_.setKeyframePose(someKeyframe(), T_w_c);
  EXPECT_EQ(linearizedNow(), 1U);
  Vector6d turn = Vector6d::Zero();
  turn[4] = 1.1 * kStillLinear_rad;
  map_.setKeyframePose(someKeyframe(), T_w_c.retract(turn));
  EXPECT_EQ(linearizedNow(), 1U);
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, AllThatSeeAMarkerThatMovesAreLinearizedAnew) {
  (void)recoveredWithKept();
  displace(someMarker(), 1.1 * kStillLinear_sides * kSize_m);
  EXPECT_EQ(linearizedNow(), map_.viewsOf(someMarker()).size());
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, AMarkerWithoutAPoseIsNoUnknownAnyMore) {
  (void)recoveredWithKept();
  map_.quarantine(someMarker());
  EXPECT_EQ(linearizedNow(), map_.viewsOf(someMarker()).size());
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, ADifferentObservationIsLinearizedAnew) {
  (void)recoveredWithKept();
  testing::displaceView(someKeyframe(), someMarker(), 1e-4, &map_);
  EXPECT_EQ(linearizedNow(), 1U);
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, ADifferentLinkIsLinearizedAnew) {
  (void)recoveredWithKept();
  const Keyframe& last = map_.keyframes().rbegin()->second;
  MarkerLink link{1, last.T_w_c.inverse() * *map_.find(1)->T_w_m, 1e-6 * Matrix6d::Identity()};
  map_.addLink(last.id, link);
  EXPECT_EQ(linearizedNow(), 1U);
  link.covariance *= 2.0;
  map_.addLink(last.id, link);
  EXPECT_EQ(linearizedNow(), 1U);
  link.T_c_m.p.x() += 1e-3;
  map_.addLink(last.id, link);
  EXPECT_EQ(linearizedNow(), 1U);
  expectAsWithoutKept(1e-9);
  map_.removeLinksTo(1);
  EXPECT_EQ(linearizedNow(), 1U);
  expectAsWithoutKept(1e-9);
}

TEST_F(KeptInformationTest, AnotherSigmaIsLinearizedAnew) {
  (void)recoveredWithKept();
  EXPECT_EQ(linearizedNow(1.0 + 0.9 * kSameSigma), 0U);
  EXPECT_EQ(linearizedNow(1.0 + 1.5 * kSameSigma), map_.keyframes().size());
}

// Within the bounds nothing is linearized anew, and yet how far the map is from its best counts
// from where it is now: all of the move goes into what is told of the marker beside its neighbour.
TEST_F(KeptInformationTest, SmallMovesAreCarriedToFirstOrder) {
  optimize();
  const int neighbour = map_.keyframes().at(someKeyframe()).detections[1].id;
  const auto apart_m2 = [&](const MapMarginals& m) {
    return (*m.find(someMarker()))(0, 0) + (*m.find(neighbour))(0, 0) -
           2.0 * (*m.between(someMarker(), neighbour))(0, 0);
  };
  const double before_m2 = apart_m2(recoveredWithKept());
  const double move_m = 0.9 * kStillLinear_sides * kSize_m;
  displace(someMarker(), move_m);
  EXPECT_EQ(linearizedNow(), 0U);
  EXPECT_NEAR(apart_m2(recoveredWithKept()) - before_m2, move_m * move_m, 0.02 * move_m * move_m);
}

TEST_F(KeptInformationTest, WithoutRoomItIsTheSame) {
  (void)recoveredWithKept();
  const std::size_t all = kept_.bytes();
  kept_ = KeptInformation(all / 2);
  expectAsWithoutKept(1e-9);
  EXPECT_LE(kept_.bytes(), all / 2);
  EXPECT_GT(kept_.size(), 0U);
  expectAsWithoutKept(1e-9);
}

// Two markers that no keyframe sees together: the second one's error in the world is that of the
// link, and what its views leave open.
TEST(LinkedMarkers, AreAsUncertainAsTheirLink) {
  const CameraModel camera{testing::testCalibration()};
  const Transform T_w_a = testing::markerFacing({0.0, 1.5, 0.1}, {0.3, 0.0, 0.1});
  const Transform T_w_b = testing::markerFacing({3.0, 1.5, 0.1}, {3.3, 0.0, 0.0});
  Vector6d sigma;
  sigma << 0.01, 0.02, 0.01, 0.004, 0.006, 0.005;
  MarkerOptions options;
  options.size_m = kSize_m;
  double nees = 0.0;
  constexpr int kRuns = 60;
  for (int run = 0; run < kRuns; ++run) {
    std::mt19937 rng(static_cast<unsigned>(run));
    std::normal_distribution<double> normal;
    std::vector<Transform> views;
    for (const double x : {0.0, 0.2, 0.4, 2.8, 3.0, 3.2}) {
      views.push_back(testing::lookAt({x, 0.0, 0.1}, {x < 1.0 ? 0.1 : 3.1, 1.5, 0.0}));
    }
    Map map = testing::trueMap(camera, views, {{0, T_w_a}, {1, T_w_b}}, kSize_m, kSigma_px, &rng);
    ASSERT_EQ(map.viewsOf(0).size(), 3U);
    ASSERT_EQ(map.viewsOf(1).size(), 3U);
    Vector6d drift;
    for (int i = 0; i < 6; ++i) drift[i] = sigma[i] * normal(rng);
    const Transform T_c_a = views[3].inverse() * T_w_a;
    map.addLink(3, {0, T_c_a.retract(drift), Matrix6d(sigma.cwiseAbs2().asDiagonal())});
    (void)optimizeGlobally(
        &map, options,
        {.max_iterations = 50, .min_relative_decrease = 1e-12, .estimate_residual_sigma = false});
    const MapMarginals marginals = runToCompletion([&](Budget* budget) {
      return recoverMarginals(map, options, CameraUncertainty{}, 1.0, budget);
    });
    const Vector6d error = T_w_b.localCoordinates(*map.find(1)->T_w_m);
    nees += error.dot(marginals.find(1)->llt().solve(error)) / kRuns;
    ASSERT_NE(marginals.findBetween(0, 1), nullptr);
  }
  // 95 % of means of 60 are from 5.2 to 6.9.
  EXPECT_GT(nees, 5.0);
  EXPECT_LT(nees, 7.1);
}

}  // namespace
}  // namespace waymark::slam
