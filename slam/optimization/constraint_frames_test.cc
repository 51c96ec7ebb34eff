#include "slam/optimization/constraint_frames.h"

#include <cmath>
#include <random>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "slam/map/world_reference.h"
#include "slam/optimization/block_kernels.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/optimization/marker_relation.h"
#include "slam/testing/scene.h"
#include "slam/testing/wall_scene.h"

namespace waymark::slam {
namespace {

constexpr int kMarkers = 12;
constexpr double kSigma_px = 0.1;
constexpr double kNoKernel = 1e9;

const BundleOptions kToTheEnd{.max_iterations = 50, .min_relative_decrease = 1e-10};

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// Markers of a wall, and what somebody who walks along it has seen of them.
class ConstraintFramesTest : public ::testing::Test {
 protected:
  ConstraintFramesTest()
      : truth_(testing::wallMarkers(kMarkers, 0.0, 0.0, &rng_)), map_(mapOf(truth_)) {
    options_.size_m = testing::kWallMarker_m;
  }

  Map mapOf(const std::vector<testing::SyntheticMarker>& markers, double sigma_px = kSigma_px) {
    return testing::trueMap(camera_, testing::wallViews(kMarkers), markers, testing::kWallMarker_m,
                            sigma_px, &rng_);
  }

  void knowThePlane() { constraints().planes = {{.name = "north", .ids = {{0, kMarkers - 1}}}}; }
  MarkerConstraints& constraints() { return options_.constraints; }

  [[nodiscard]] ConstraintFrames frames() const {
    return constraintFrames(options_.constraints, constrainedMarkers(map_, options_),
                            isInSurvey(map_, options_));
  }

  BundleSummary optimize() { return optimizeGlobally(&map_, options_, kToTheEnd); }

  [[nodiscard]] double offWall_m(int id) const {
    return std::abs(map_.findPosed(id)->T_w_m->p.y() - 3.0);
  }
  [[nodiscard]] double error_m(int id) const {
    return (map_.findPosed(id)->T_w_m->p - truth_[at(id)].T_w_m.p).norm();
  }
  [[nodiscard]] double cornerDistance_m(int a, int corner_a, int b, int corner_b) const {
    const auto corners = markerCorners(testing::kWallMarker_m);
    return (truth_[at(a)].T_w_m * corners[at(corner_a)] -
            truth_[at(b)].T_w_m * corners[at(corner_b)])
        .norm();
  }

  std::mt19937 rng_{11};
  CameraModel camera_{testing::testCalibration()};
  MarkerOptions options_;
  std::vector<testing::SyntheticMarker> truth_;
  Map map_;
};

TEST_F(ConstraintFramesTest, NothingKnownNeedsNoFrame) {
  EXPECT_TRUE(constrainedMarkers(map_, options_).empty());
  EXPECT_TRUE(frames().frames.empty());
}

TEST_F(ConstraintFramesTest, APlaneIsWhereItsMarkersHaveIt) {
  knowThePlane();
  const ConstraintFrames known = frames();
  ASSERT_EQ(known.frames.size(), 1U);
  const ConstraintFrame& plane = known.frames.front();
  EXPECT_EQ(plane.members.size(), at(kMarkers));
  EXPECT_EQ(known.sources.size(), at(2 * kMarkers)) << "place and face of each";
  EXPECT_FALSE(plane.fixed);
  EXPECT_NEAR(plane.T_w_f.p.y(), 3.0, 1e-9);
  EXPECT_LT((plane.T_w_f.R.col(2) + Eigen::Vector3d::UnitY()).norm(), 1e-9);
}

TEST_F(ConstraintFramesTest, OneMarkerElsewhereDoesNotMoveThePlane) {
  knowThePlane();
  Transform off = truth_[3].T_w_m;
  off.p.y() += 0.5;
  map_.place(3, off);
  EXPECT_NEAR(frames().frames.at(0).T_w_f.p.y(), 3.0, 1e-3) << "a third of a sigma";
}

// A marker that is not in the map yet, and what would tie one marker to nothing.
TEST_F(ConstraintFramesTest, WhatTiesNothingIsLeftOut) {
  constraints().planes = {{.ids = {{5, 5}, {500, 510}}}};
  constraints().distances = {{.id_a = 5, .id_b = 500, .distance_m = 1.0}};
  constraints().positions = {{.id = 1}, {.id = 2}, {.id = 300}};
  EXPECT_EQ(constrainedMarkers(map_, options_).size(), 3U);
  const ConstraintFrames known = frames();
  EXPECT_TRUE(known.frames.empty()) << "two positions fix no world";
  EXPECT_TRUE(known.distances.empty());
}

TEST_F(ConstraintFramesTest, WallsAloneHaveNoVertical) {
  constraints().planes = {{.ids = {{0, 5}}, .kind = PlaneKind::kWall}};
  EXPECT_EQ(frames().frames.size(), 1U) << "the plane";
  constraints().upright.ids = {{6, 7}};
  ASSERT_EQ(frames().frames.size(), 2U);
  EXPECT_EQ(frames().frames[1].members.size(), 8U);
  EXPECT_LT((frames().frames[1].T_w_f.R.col(2) - Eigen::Vector3d::UnitZ()).norm(), 1e-6);
}

TEST_F(ConstraintFramesTest, AVerticalThatIsToldIsFixed) {
  constraints().planes = {{.ids = {{0, 5}}, .kind = PlaneKind::kWall}};
  constraints().up_w = Eigen::Vector3d(0.0, 0.0, 9.81);
  const ConstraintFrames known = frames();
  ASSERT_EQ(known.frames.size(), 2U);
  EXPECT_TRUE(known.frames[1].fixed);
  EXPECT_LT((known.frames[1].T_w_f.R.col(2) - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
}

// Of three markers that face up and three that face down.
TEST_F(ConstraintFramesTest, FloorAndCeilingShareTheVertical) {
  Map map;
  for (int i = 0; i < 6; ++i) {
    const bool up = i < 3;
    const Eigen::Vector3d centre(i, 0.3 * i * i, up ? 0.0 : 2.5);
    map.addMarker(i, 0.2);
    map.place(i, testing::markerFacing(
                     centre, centre + (up ? 1.0 : -1.0) * Eigen::Vector3d(0.02, 0.01, 1.0)));
  }
  constraints().planes = {{.ids = {{0, 2}}, .kind = PlaneKind::kFloor},
                          {.ids = {{3, 5}}, .kind = PlaneKind::kCeiling}};
  const ConstraintFrames known =
      constraintFrames(constraints(), constrainedMarkers(map, options_), false);
  ASSERT_EQ(known.frames.size(), 3U);
  const Eigen::Vector3d up = known.frames[2].T_w_f.R.col(2);
  EXPECT_LT((up - Eigen::Vector3d(0.02, 0.01, 1.0).normalized()).norm(), 1e-3);
}

// With the ruler eliminated, what is left between the markers is the one residual of the distance.
TEST_F(ConstraintFramesTest, ARulerIsTheDistanceItself) {
  constraints().distances = {
      {.id_a = 2, .corner_a = 1, .id_b = 9, .corner_b = 3, .distance_m = 6.9, .sigma_m = 0.004}};
  const std::vector<ConstrainedMarker> markers = constrainedMarkers(map_, options_);
  const ConstraintFrames known = frames();
  ASSERT_EQ(known.distances.size(), 1U);
  const ConstraintFrame ruler = rulerOf(known.distances.front(), markers);
  const Eigen::Vector3d a = markers[0].T_w_m * markerCorners(testing::kWallMarker_m)[1];
  const Eigen::Vector3d b = markers[1].T_w_m * markerCorners(testing::kWallMarker_m)[3];
  const double error = ((b - a).norm() - 6.9) / 0.004;
  double cost = 0.0;
  Eigen::Matrix<double, 18, 18> H = Eigen::Matrix<double, 18, 18>::Zero();  // a, b, ruler
  Eigen::Matrix<double, 18, 1> g = Eigen::Matrix<double, 18, 1>::Zero();
  for (std::size_t i = 0; i < 2; ++i) {
    const Transform& T_w_m = markers[i].T_w_m;
    const auto& relations = ruler.members[i].relations;
    const RelationSums sums = sumRelations(relations, ruler.T_w_f, T_w_m, kNoKernel);
    cost += relationCost(relations, ruler.T_w_f, T_w_m, kNoKernel);
    const Matrix6d K =
        transposedTransport<6>(T_w_m.p - ruler.T_w_f.p, Matrix6d::Identity()).transpose();
    const auto own = static_cast<Eigen::Index>(6 * i);
    H.block<6, 6>(own, own) = sums.H;
    H.block<6, 6>(own, 12) = -sums.H * K;
    H.block<6, 6>(12, own) = H.block<6, 6>(own, 12).transpose();
    H.block<6, 6>(12, 12) += K.transpose() * sums.H * K;
    g.segment<6>(own) = sums.g;
    g.tail<6>() -= K.transpose() * sums.g;
  }
  EXPECT_NEAR(cost, error * error, 1e-9 * cost);
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = ruler.T_w_f.R;
  H.block<6, 6>(12, 12) += turn * ruler.gauge.asDiagonal() * turn.transpose();
  const Eigen::Matrix<double, 12, 6> to_ruler =
      H.block<12, 6>(0, 12) * H.block<6, 6>(12, 12).inverse();
  const Eigen::Matrix<double, 12, 12> left =
      H.topLeftCorner<12, 12>() - to_ruler * H.block<6, 12>(12, 0);
  const Eigen::Matrix<double, 12, 1> left_g = g.head<12>() - to_ruler * g.tail<6>();
  // The distance, directly.
  const Eigen::Vector3d along = (b - a).normalized();
  Eigen::Matrix<double, 12, 1> J;
  J << -along, -(a - markers[0].T_w_m.p).cross(along), along, (b - markers[1].T_w_m.p).cross(along);
  J /= 0.004;
  EXPECT_LT((left - J * J.transpose()).norm(), 1e-6 * left.norm());
  EXPECT_LT((left_g - J * error).norm(), 1e-6 * left_g.norm());
}

// A map that is bent along the wall, as drift bends it, becomes straight again; more of it than
// without.
TEST_F(ConstraintFramesTest, APlaneStraightensTheMap) {
  Map free = map_;
  (void)optimizeGlobally(&free, options_, kToTheEnd);
  const double before_m = std::abs(free.findPosed(kMarkers - 1)->T_w_m->p.y() - 3.0);
  knowThePlane();
  Vector6d whole = Vector6d::Zero();
  whole[1] = 0.1;
  testing::bend(whole, &map_);
  const BundleSummary summary = optimize();
  EXPECT_FALSE(summary.failed);
  EXPECT_EQ(summary.gated_constraints, 0);
  EXPECT_LT(offWall_m(kMarkers - 1), 0.5 * before_m) << before_m;
}

TEST_F(ConstraintFramesTest, ADistanceSetsTheScale) {
  for (const auto& [id, keyframe] : map_.keyframes()) {
    Transform T_w_c = keyframe.T_w_c;
    T_w_c.p.x() *= 1.01;
    map_.setKeyframePose(id, T_w_c);
  }
  Map free = map_;
  (void)optimizeGlobally(&free, options_, kToTheEnd);
  constraints().distances = {{.id_a = 0,
                              .corner_a = 0,
                              .id_b = kMarkers - 1,
                              .corner_b = 2,
                              .distance_m = cornerDistance_m(0, 0, kMarkers - 1, 2),
                              .sigma_m = 1e-4}};
  EXPECT_EQ(optimize().gated_constraints, 0);
  const auto off_m = [&](const Map& map) {
    const auto corners = markerCorners(testing::kWallMarker_m);
    const double found_m =
        (*map.findPosed(0)->T_w_m * corners[0] - *map.findPosed(kMarkers - 1)->T_w_m * corners[2])
            .norm();
    return std::abs(found_m - constraints().distances[0].distance_m);
  };
  EXPECT_GT(off_m(free), 5e-4);
  EXPECT_LT(off_m(map_), 1.5e-4);
}

// The markers hang straight; the map has been turned about the view of its first keyframe, which
// holds the world.
TEST_F(ConstraintFramesTest, UprightMarkersShareTheirVertical) {
  constraints().upright = {.ids = {{0, kMarkers - 1}}, .sigma_rad = 0.001};
  EXPECT_EQ(optimize().gated_constraints, 0);
  for (int id = 0; id < kMarkers; ++id) {
    const Eigen::Vector3d up = map_.findPosed(id)->T_w_m->R.col(1);
    EXPECT_LT((up - map_.findPosed(0)->T_w_m->R.col(1)).norm(), 2e-3) << id;
  }
}

// Marker 5 hangs 5 cm in front of the wall that it is said to be on. Nothing else is bent, but by
// what its face says, which goes on to count.
TEST_F(ConstraintFramesTest, WhatIsContradictedBendsNothing) {
  truth_[5].T_w_m.p.y() -= 0.05;
  map_ = mapOf(truth_);
  Map without_it = map_;
  knowThePlane();
  MarkerOptions others = options_;
  others.constraints.planes[0].ids = {{0, 4}, {6, kMarkers - 1}};
  (void)optimizeGlobally(&without_it, others, kToTheEnd);
  const BundleSummary summary = optimize();
  EXPECT_EQ(summary.gated_constraints, 1);
  for (int id = 0; id < kMarkers; ++id) {
    const double apart_m =
        (map_.findPosed(id)->T_w_m->p - without_it.findPosed(id)->T_w_m->p).norm();
    EXPECT_LT(apart_m, 3e-4) << id;
  }
}

TEST_F(ConstraintFramesTest, AWrongDistanceBendsNothing) {
  Map without_it = map_;
  (void)optimizeGlobally(&without_it, options_, kToTheEnd);
  constraints().distances = {
      {.id_a = 1, .id_b = 4, .distance_m = cornerDistance_m(1, 0, 4, 0) + 0.2}};
  EXPECT_EQ(optimize().gated_constraints, 1);
  for (int id = 0; id < kMarkers; ++id) {
    const double apart_m =
        (map_.findPosed(id)->T_w_m->p - without_it.findPosed(id)->T_w_m->p).norm();
    EXPECT_LT(apart_m, 1e-4) << id;
  }
}

// Positions on an arc: the world is theirs, whatever it was before.
TEST_F(ConstraintFramesTest, PositionsHoldTheWorld) {
  const Transform T_s_w = testing::disturbed(Transform{}, 0.5, &rng_);
  for (const int id : {0, 3, 6, 9, 11}) {
    constraints().positions.push_back({.id = id, .p_w = T_s_w * truth_[at(id)].T_w_m.p});
  }
  EXPECT_TRUE(positionsFixWorld(map_, options_));
  map_.moveWorld(surveyedFromMap(map_, options_));
  const BundleSummary summary = optimize();
  EXPECT_FALSE(summary.failed);
  EXPECT_EQ(summary.gated_constraints, 0);
  for (int id = 0; id < kMarkers; ++id) {
    EXPECT_LT((map_.findPosed(id)->T_w_m->p - T_s_w * truth_[at(id)].T_w_m.p).norm(), 0.01) << id;
  }
}

// Local optimizations: markers of the plane that take no part are there, held.
TEST_F(ConstraintFramesTest, APartIsHeldByTheRest) {
  knowThePlane();
  const KeyframeId last = map_.keyframes().rbegin()->first;
  LocalMapOptions small;
  small.max_keyframes = 3;
  const SubproblemMembers roles = localMap(map_, last, small);
  const Subproblem part =
      runToCompletion([&](Budget* a) { return buildSubproblem(map_, roles, options_, a); });
  ASSERT_LT(part.markers.size(), at(kMarkers));
  EXPECT_EQ(part.problem.markers.size(), at(kMarkers));
  EXPECT_EQ(part.problem.constraints.size(), at(kMarkers));
  EXPECT_EQ(part.problem.cameras.size(), part.keyframes.size() + 1);
  for (std::size_t i = part.markers.size(); i < part.problem.markers.size(); ++i) {
    EXPECT_TRUE(part.problem.markers[i].fixed);
  }
  EXPECT_FALSE(optimizeLocally(&map_, last, options_, kToTheEnd).failed);
}

// Nothing but what is known ties them: one view of each marker, each from a keyframe of its own.
TEST_F(ConstraintFramesTest, MarkersThatNothingElseTiesAreNoTrouble) {
  Map apart;
  for (int id = 0; id < 4; ++id) {
    Keyframe keyframe;
    keyframe.T_w_c = testing::lookAt({1.0 * id, 0.0, 0.0}, {id + 0.3, 3.0, 0.2});
    keyframe.detections = {*testing::observe(camera_, keyframe.T_w_c, id, truth_[at(id)].T_w_m,
                                             testing::kWallMarker_m, kSigma_px, &rng_)};
    apart.addMarker(id, testing::kWallMarker_m);
    apart.place(id, truth_[at(id)].T_w_m);
    (void)apart.addKeyframe(std::move(keyframe));
  }
  knowThePlane();
  constraints().distances = {{.id_a = 0, .id_b = 1, .distance_m = cornerDistance_m(0, 0, 1, 0)}};
  map_ = apart;
  const BundleSummary summary = optimize();
  EXPECT_FALSE(summary.failed);
  for (int id = 0; id < 4; ++id) EXPECT_TRUE(map_.findPosed(id)->T_w_m->p.allFinite());
}

}  // namespace
}  // namespace waymark::slam
