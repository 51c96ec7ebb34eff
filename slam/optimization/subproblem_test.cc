#include "slam/optimization/subproblem.h"

#include <algorithm>
#include <random>
#include <utility>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;
const Transform kElsewhere{expSo3({0.1, -0.2, 0.3}), {7.0, 8.0, 9.0}};

bool same(const Transform& a, const Transform& b) { return a.p == b.p && a.R == b.R; }

Transform somewhere(double x_m) { return {expSo3({0.0, 0.1 * x_m, 0.0}), {x_m, 0.0, 0.0}}; }

MarkerDetection seen(int id) {
  MarkerDetection detection;
  detection.id = id;
  detection.normalized[0].x() = 0.1 * id;
  return detection;
}

// A chain: 0 sees 1 and 2, 1 sees 2 and 3, 2 sees 3 and 4, 3 sees 4 and 5; 4 sees 6, and 5 sees 5.
// Marker 5 has no pose.
Map chain() {
  Map map;
  for (int id = 1; id <= 6; ++id) {
    (void)map.addMarker(id, id == 3 ? 2.0 * kSize : kSize);
    if (id != 5) map.place(id, somewhere(id));
  }
  const std::vector<std::vector<int>> views = {{1, 2}, {2, 3}, {3, 4}, {4, 5}, {6}, {5}};
  for (std::size_t k = 0; k < views.size(); ++k) {
    Keyframe keyframe;
    keyframe.T_w_c = somewhere(-1.0 - static_cast<double>(k));
    for (const int id : views[k]) keyframe.detections.push_back(seen(id));
    (void)map.addKeyframe(keyframe);
  }
  return map;
}

using Keyframes = std::vector<KeyframeId>;

Keyframes of(const SubproblemMembers& members, bool held) {
  Keyframes ids;
  for (const auto& role : members.keyframes) {
    if (role.held == held) ids.push_back(role.keyframe);
  }
  return ids;
}

Subproblem build(const Map& map, const SubproblemMembers& members,
                 const MarkerOptions& options = {.size_m = kSize}) {
  return runToCompletion([&](Budget* b) { return buildSubproblem(map, members, options, b); });
}

Keyframes fixedKeyframes(const Subproblem& part) {
  Keyframes ids;
  for (std::size_t c = 0; c < part.keyframes.size(); ++c) {
    if (part.problem.cameras[c].fixed) ids.push_back(part.keyframes[c]);
  }
  return ids;
}

std::vector<int> markersOf(const Subproblem& part, bool fixed) {
  std::vector<int> ids;
  for (std::size_t m = 0; m < part.markers.size(); ++m) {
    if (part.problem.markers[m].fixed == fixed) ids.push_back(part.markers[m].id);
  }
  return ids;
}

TEST(SubproblemMembers, OfTheWholeMap) {
  const SubproblemMembers members = wholeMap(chain());
  EXPECT_EQ(of(members, false), (Keyframes{0, 1, 2, 3, 4, 5}));
  EXPECT_TRUE(of(members, true).empty());
  EXPECT_EQ(members.markers, (std::vector<int>{1, 2, 3, 4, 5, 6}));
}

// Eq. 30 to 32.
TEST(SubproblemMembers, OfTheLocalMap) {
  const Map map = chain();
  const SubproblemMembers of_1 = localMap(map, 1);
  EXPECT_EQ(of(of_1, false), (Keyframes{0, 1, 2}));
  EXPECT_EQ(of_1.markers, (std::vector<int>{1, 2, 3, 4}));
  EXPECT_EQ(of(of_1, true), (Keyframes{3})) << "it sees 4, as 2 does";
  const SubproblemMembers of_2 = localMap(map, 2);
  EXPECT_EQ(of(of_2, false), (Keyframes{1, 2, 3}));
  EXPECT_EQ(of(of_2, true), (Keyframes{0})) << "5 has no pose: who else sees it holds nothing";
  const SubproblemMembers of_4 = localMap(map, 4);
  EXPECT_EQ(of(of_4, false), (Keyframes{4})) << "alone with its marker";
  EXPECT_TRUE(of(of_4, true).empty());
}

// Where many see the same markers.
TEST(SubproblemMembers, OfALocalMapThatIsTooLarge) {
  Map map = chain();
  const auto see = [&](std::vector<int> ids) {
    Keyframe keyframe;
    for (const int id : ids) keyframe.detections.push_back(seen(id));
    return map.addKeyframe(keyframe);
  };
  const KeyframeId often = see({2, 3, 4});
  const KeyframeId newest = see({2, 3});
  const SubproblemMembers two = localMap(map, newest, {.max_keyframes = 2, .held_views = 1});
  EXPECT_EQ(of(two, false), (Keyframes{often, newest})) << "as 1, but newer";
  EXPECT_EQ(two.markers, (std::vector<int>{2, 3, 4}));
  EXPECT_EQ(of(two, true), (Keyframes{1, 2})) << "1 holds 2 and 3, and 2 holds 4";
  const SubproblemMembers of_two_views =
      localMap(map, newest, {.max_keyframes = 2, .held_views = 2});
  EXPECT_EQ(of(of_two_views, true), (Keyframes{0, 1, 2, 3}));
  EXPECT_EQ(of(localMap(map, newest, {.max_keyframes = 3, .held_views = 1}), false),
            (Keyframes{1, often, newest}));
}

SubproblemMembers region(const Map& map, const std::vector<KeyframeId>& seeds, int keyframes) {
  return runToCompletion([&](Budget* a) { return regionAround(map, seeds, keyframes, a); });
}

TEST(SubproblemMembers, OfTheRegionAroundKeyframes) {
  const Map map = chain();
  const std::vector<KeyframeId> seeds = {0};
  const SubproblemMembers two = region(map, seeds, 2);
  EXPECT_EQ(of(two, false), (Keyframes{0, 1}));
  EXPECT_EQ(two.markers, (std::vector<int>{1, 2, 3}));
  EXPECT_EQ(of(two, true), (Keyframes{2}));
  const SubproblemMembers all_it_leads_to = region(map, seeds, 100);
  EXPECT_EQ(of(all_it_leads_to, false), (Keyframes{0, 1, 2, 3, 5}));
  EXPECT_TRUE(of(all_it_leads_to, true).empty());
  const std::vector<KeyframeId> both_ends = {4, 0, 4};
  EXPECT_EQ(of(region(map, both_ends, 3), false), (Keyframes{0, 1, 4}));
}

TEST(SubproblemMembers, OfTheNewestKeyframes) {
  const Map map = chain();
  const SubproblemMembers three = newestMap(map, 3);
  EXPECT_EQ(of(three, true), (Keyframes{3})) << "the oldest of them";
  EXPECT_EQ(of(three, false), (Keyframes{4, 5}));
  EXPECT_EQ(three.markers, (std::vector<int>{4, 5, 6}));
  EXPECT_EQ(of(newestMap(map, 100), false), (Keyframes{1, 2, 3, 4, 5}));
  EXPECT_TRUE(newestMap(Map{}, 3).keyframes.empty());
}

TEST(Subproblem, HasCopiesOfWhatItsMembersAreAndSee) {
  Map map = chain();
  for (int move = 0; move < 2; ++move) {
    const Transform T_w_m = *map.find(4)->T_w_m;
    map.quarantine(4);
    map.place(4, T_w_m);
  }
  map.beginEpoch();
  const Subproblem part = build(map, wholeMap(map));
  EXPECT_EQ(part.epoch, map.epoch());
  EXPECT_EQ(part.keyframes, (Keyframes{0, 1, 2, 3, 4})) << "5 sees none with a pose";
  EXPECT_EQ(markersOf(part, false), (std::vector<int>{1, 2, 3, 4, 6}));
  EXPECT_EQ(part.markers[3].former_poses, 2U);
  EXPECT_EQ(part.markerIndex(6), 4);
  EXPECT_EQ(part.markerIndex(5), -1);
  EXPECT_EQ(part.markerIndex(99), -1);
  EXPECT_EQ(part.problem.marker_sizes_m,
            (std::vector<double>{kSize, kSize, 2.0 * kSize, kSize, kSize}));
  EXPECT_TRUE(same(part.problem.markers[3].T, somewhere(4.0)));
  EXPECT_TRUE(same(part.problem.cameras[2].T, somewhere(-3.0)));

  ASSERT_EQ(part.problem.observations.size(), 8U);
  for (std::size_t i = 0; i < 8; ++i) {
    const auto& observation = part.problem.observations[i];
    const KeyframeId keyframe = part.keyframes[static_cast<std::size_t>(observation.camera)];
    const int id = part.markers[static_cast<std::size_t>(observation.marker)].id;
    const MarkerDetection* const original = map.keyframes().at(keyframe).find(id);
    ASSERT_NE(original, nullptr) << keyframe << " does not see " << id;
    EXPECT_EQ(observation.detection, original) << "shared";
  }
}

TEST(Subproblem, TheFirstKeyframeIsTheWorldUnlessMarkersAre) {
  const Map map = chain();
  const Subproblem local = build(map, localMap(map, 1));
  EXPECT_EQ(fixedKeyframes(local), (Keyframes{0, 3})) << "the world, and who is held";
  EXPECT_TRUE(local.problem.priors.empty());

  const Subproblem by_origin = build(map, localMap(map, 1), {.size_m = kSize, .origin_marker = 2});
  EXPECT_EQ(fixedKeyframes(by_origin), (Keyframes{3}));
  EXPECT_EQ(markersOf(by_origin, true), (std::vector<int>{2}));
  const Subproblem far_from_origin =
      build(map, localMap(map, 4), {.size_m = kSize, .origin_marker = 2});
  EXPECT_TRUE(markersOf(far_from_origin, true).empty());
}

TEST(Subproblem, AnchorsArePriorsOfThoseThatTakePart) {
  const Map map = chain();
  const MarkerOptions options{
      .size_m = kSize,
      .anchors = {
          {3, kElsewhere, 0.01, 0.02}, {5, kElsewhere, 0.01, 0.02}, {6, kElsewhere, 0.01, 0.02}}};
  const Subproblem part = build(map, localMap(map, 1), options);
  EXPECT_EQ(fixedKeyframes(part), (Keyframes{3})) << "the anchors' is the world";
  ASSERT_EQ(part.problem.priors.size(), 1U);
  const BundleProblem::Prior& prior = part.problem.priors.front();
  EXPECT_EQ(prior.marker, part.markerIndex(3));
  EXPECT_TRUE(same(prior.T_w_m, kElsewhere)) << "where it was surveyed, not where it is";
  Vector6d information;
  information << 1e4, 1e4, 1e4, 2500.0, 2500.0, 2500.0;
  EXPECT_LT((prior.information - Matrix6d(information.asDiagonal())).norm(), 1e-6);
  EXPECT_TRUE(markersOf(part, true).empty()) << "a prior does not fix";
}

// The map goes on living while it is taken out of it.
TEST(Subproblem, IsOfTheFirstSlice) {
  Map map = chain();
  const MarkerOptions markers{.size_m = kSize};  // outlives the task
  SlicedTask<Subproblem> task(
      [&](Budget* b) { return buildSubproblem(map, wholeMap(map), markers, b); });
  ASSERT_FALSE(task.advance(0.02));
  map.setKeyframePose(1, kElsewhere);
  map.place(2, kElsewhere);
  map.removeKeyframe(2);
  int slices = 1;
  while (!task.advance(0.02)) ++slices;
  EXPECT_GT(slices, 5);
  const Subproblem part = task.take();
  EXPECT_TRUE(same(part.problem.cameras[1].T, somewhere(-2.0)));
  EXPECT_TRUE(same(part.problem.markers[1].T, somewhere(2.0)));
  EXPECT_EQ(part.keyframes[2], 2) << "it had begun with it";
  EXPECT_EQ(std::ranges::count(part.problem.observations, 2, &BundleProblem::Observation::camera),
            0);
  EXPECT_EQ(part.problem.observations.size(), 6U);
}

// So large a map is not taken out in one piece, and lives on between the slices.
TEST(Subproblem, OfALargeMapIsOfTheSliceThatComesToIt) {
  constexpr KeyframeId kKeyframes = 1200;
  constexpr KeyframeId kEndsBatch = 499;
  Map map;
  (void)map.addMarker(1, kSize);
  map.place(1, somewhere(1.0));
  for (KeyframeId id = 0; id < kKeyframes; ++id) {
    Keyframe keyframe;
    keyframe.T_w_c = somewhere(static_cast<double>(id));
    keyframe.detections.push_back(seen(1));
    (void)map.addKeyframe(keyframe);
  }
  const MarkerOptions markers{.size_m = kSize};  // outlives the task
  SlicedTask<Subproblem> task(
      [&](Budget* b) { return buildSubproblem(map, wholeMap(map), markers, b); });
  ASSERT_FALSE(task.advance(0.1));
  map.setKeyframePose(10, kElsewhere);    // taken already,
  map.setKeyframePose(1100, kElsewhere);  // and not yet
  for (const KeyframeId id : {kEndsBatch, kEndsBatch + 1, KeyframeId{1199}}) map.removeKeyframe(id);
  while (!task.advance(0.1)) {
  }
  const Subproblem part = task.take();
  ASSERT_EQ(part.keyframes.size(), 1197U);
  EXPECT_EQ(part.problem.observations.size(), 1197U);
  EXPECT_TRUE(std::ranges::is_sorted(part.keyframes));
  EXPECT_FALSE(std::ranges::binary_search(part.keyframes, kEndsBatch));
  EXPECT_TRUE(same(part.problem.cameras[10].T, somewhere(10.0)));
  EXPECT_EQ(part.keyframes[1098], 1100);
  EXPECT_TRUE(same(part.problem.cameras[1098].T, kElsewhere));
}

// Everything of the map a metre further.
MapCorrection shifted(const Map& map) {
  MapCorrection correction;
  correction.epoch = map.epoch();
  const Transform shift{Eigen::Matrix3d::Identity(), {0.0, 0.0, 1.0}};
  for (const auto& [id, keyframe] : map.keyframes()) {
    correction.keyframes.push_back({id, shift * keyframe.T_w_c});
  }
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m) continue;
    correction.markers.push_back(
        {{id, marker.former_poses.size()}, shift * *marker.T_w_m, id * Matrix6d::Identity()});
  }
  return correction;
}

// The members are chosen before the first slice, and the map goes on in between.
TEST(Subproblem, KeyframesThatAreGoneTakeNoPart) {
  Map map = chain();
  const SubproblemMembers members = wholeMap(map);
  map.removeKeyframe(4);
  map.removeKeyframe(1);
  EXPECT_EQ(build(map, members).keyframes, (Keyframes{0, 2, 3}));
}

TEST(MapCorrection, GoesIntoTheMap) {
  Map map = chain();
  ASSERT_TRUE(apply(shifted(map), &map));
  for (const auto& [id, keyframe] : map.keyframes()) EXPECT_EQ(keyframe.T_w_c.p.z(), 1.0) << id;
  for (const auto& [id, marker] : map.markers()) {
    EXPECT_EQ(marker.T_w_m.has_value(), id != 5);
    if (!marker.T_w_m) continue;
    EXPECT_EQ(marker.T_w_m->p.z(), 1.0) << id;
    EXPECT_EQ(marker.covariance(2, 2), id);
  }
}

TEST(MapCorrection, OfAnotherEpochIsRefused) {
  Map map = chain();
  const MapCorrection correction = shifted(map);
  map.beginEpoch();
  EXPECT_FALSE(apply(correction, &map));
  EXPECT_FALSE(applyAround(1, correction, &map));
  for (const auto& [id, keyframe] : map.keyframes()) EXPECT_EQ(keyframe.T_w_c.p.z(), 0.0) << id;
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m) continue;
    EXPECT_EQ(marker.T_w_m->p.z(), 0.0) << id;
  }
}

TEST(MapCorrection, LeavesWhatHasMovedOrGoneMeanwhile) {
  Map map = chain();
  const MapCorrection correction = shifted(map);
  map.removeKeyframe(3);
  map.quarantine(2);
  map.quarantine(4);
  map.place(4, kElsewhere);
  ASSERT_TRUE(apply(correction, &map));
  EXPECT_FALSE(map.keyframes().contains(3));
  EXPECT_FALSE(map.find(2)->T_w_m);
  EXPECT_TRUE(same(*map.find(4)->T_w_m, kElsewhere));
  EXPECT_TRUE(map.find(4)->covariance.isZero());
  EXPECT_EQ(map.find(3)->T_w_m->p.z(), 1.0) << "the others follow";
}

TEST(MapCorrection, TellsWhatItDidToAKeyframe) {
  Map map = chain();
  MapCorrection correction = shifted(map);
  correction.keyframes[2].T_w_c = kElsewhere;
  const Transform T_was = map.keyframes().at(2).T_w_c;
  const auto T_new_old = applyAround(2, correction, &map);
  ASSERT_TRUE(T_new_old);
  const Transform T_is = *T_new_old * T_was;
  EXPECT_LT((T_is.p - kElsewhere.p).norm() + (T_is.R - kElsewhere.R).norm(), 1e-12);
  map.removeKeyframe(2);
  const auto gone = applyAround(2, correction, &map);
  ASSERT_TRUE(gone);
  EXPECT_TRUE(same(*gone, Transform{}));
}

// Where a camera was carried to is corrected by its markers, which stay where they are: what
// follows these does not go with the camera.
TEST(MapCorrection, TellsWhatItDidToTheMarkersOfACarriedKeyframe) {
  Map map = chain();
  map.addLink(2, {.marker = 1});
  MapCorrection correction = shifted(map);
  correction.keyframes[2].T_w_c = kElsewhere;
  const Eigen::Vector3d was = map.find(3)->T_w_m->p;
  const auto T_new_old = applyAround(2, correction, &map);
  ASSERT_TRUE(T_new_old);
  EXPECT_LT((*T_new_old * was - map.find(3)->T_w_m->p).norm(), 1e-12);
  EXPECT_TRUE(same(*T_new_old, {Eigen::Matrix3d::Identity(), {0.0, 0.0, 1.0}}));
}

TEST(MapCorrection, NamesPosesCovariancesAndOutliersByTheirIds) {
  std::mt19937 rng(5);
  const CameraModel camera(testing::testCalibration());
  const auto markers = testing::markerWall(2, 4, 0.5, &rng);
  std::vector<Transform> views;
  for (int i = 0; i < 8; ++i) {
    views.push_back(testing::lookAt({0.2 * i - 0.7, 0.3 * (i % 3), 0.1 * (i % 2)}, {0, 3, 0}));
  }
  Map map = testing::trueMap(camera, views, markers, kSize, 0.05, &rng);
  map.removeKeyframe(1);
  testing::displaceView(4, 6, 20.0 / camera.focalLength(), &map);
  Subproblem part = build(map, wholeMap(map));
  BundleAdjuster adjuster(std::move(part.problem), {.max_iterations = 30});
  (void)runToCompletion([&](Budget* b) { return adjuster.run(b); });
  const MapCorrection correction =
      runToCompletion([&](Budget* a) { return correctionOf(part, adjuster, a); });
  EXPECT_EQ(correction.epoch, map.epoch());
  ASSERT_EQ(correction.keyframes.size(), 7U);
  EXPECT_EQ(correction.keyframes[1].id, 2) << "1 is not there";
  EXPECT_LT((correction.keyframes[1].T_w_c.p - views[2].p).norm(), 0.01);
  ASSERT_EQ(correction.markers.size(), 8U);
  for (const auto& corrected : correction.markers) {
    EXPECT_GT(corrected.covariance.trace(), 0.0) << corrected.marker.id;
  }
  ASSERT_EQ(correction.outliers.size(), 1U);
  EXPECT_EQ(correction.outliers[0].keyframe, 4);
  EXPECT_EQ(correction.outliers[0].marker, 6);
}

}  // namespace
}  // namespace waymark::slam
