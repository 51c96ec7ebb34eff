#include "slam/optimization/late_correction.h"

#include <initializer_list>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

Transform at(double x_m) { return {expSo3({0.0, 0.0, 0.1 * x_m}), {x_m, 0.0, 0.0}}; }

// A map of two keyframes that see markers 1 and 2, and its correction, which shifts all of it.
class LateCorrectionTest : public ::testing::Test {
 protected:
  LateCorrectionTest() {
    place(1, 1.0);
    place(2, 2.0);
    (void)keyframe(0.0, {1, 2});
    newest_ = keyframe(0.5, {1, 2});
    correction_.epoch = map_.epoch();
    for (const auto& [id, keyframe] : map_.keyframes()) {
      correction_.keyframes.push_back({id, shift_ * keyframe.T_w_c});
    }
    for (const auto& [id, marker] : map_.markers()) {
      correction_.markers.push_back(
          {.marker = {.id = id, .former_poses = 0}, .T_w_m = shift_ * *marker.T_w_m});
    }
  }

  void place(int id, double x_m) {
    (void)map_.addMarker(id, 0.15);
    map_.place(id, at(x_m));
  }
  KeyframeId keyframe(double x_m, std::initializer_list<int> markers) {
    Keyframe keyframe;
    keyframe.T_w_c = at(x_m);
    for (const int id : markers) {
      MarkerDetection seen;
      seen.id = id;
      keyframe.detections.push_back(seen);
    }
    return map_.addKeyframe(keyframe);
  }
  // How far it is from where the shift takes it, metres.
  [[nodiscard]] double off_m(const Transform& T_now, const Transform& T_before) const {
    const Transform T_expected = shift_ * T_before;
    return (T_now.p - T_expected.p).norm() + rotationDistance(T_now.R, T_expected.R);
  }
  [[nodiscard]] const Transform& poseOf(KeyframeId id) const {
    return map_.keyframes().at(id).T_w_c;
  }

  const Transform shift_{expSo3({0.0, 0.02, 0.0}), {0.0, 0.03, 0.01}};
  Map map_;
  KeyframeId newest_ = -1;
  MapCorrection correction_;
};

TEST_F(LateCorrectionTest, WhatCameSinceMovesAlong) {
  place(3, 3.0);
  const KeyframeId sees_both = keyframe(1.0, {2, 3});
  place(4, 4.0);
  const KeyframeId sees_new_ones = keyframe(2.0, {3, 4});
  const auto T_new_old = applyAllLate(correction_, &map_);
  ASSERT_TRUE(T_new_old);
  EXPECT_LT(off_m(*T_new_old, {}), 1e-9);
  for (const int id : {1, 2, 3, 4}) {
    EXPECT_LT(off_m(*map_.findPosed(id)->T_w_m, at(id)), 1e-9) << id;
  }
  EXPECT_LT(off_m(poseOf(newest_), at(0.5)), 1e-9);
  EXPECT_LT(off_m(poseOf(sees_both), at(1.0)), 1e-9);
  EXPECT_LT(off_m(poseOf(sees_new_ones), at(2.0)), 1e-9);
}

// A marker that was without a pose then, but seen.
TEST_F(LateCorrectionTest, WhatGotAPoseSinceMovesAsTheKeyframeThatSawIt) {
  (void)map_.addMarker(5, 0.15);
  MarkerDetection seen;
  seen.id = 5;
  map_.addView(newest_, seen);
  map_.place(5, at(5.0));
  ASSERT_TRUE(applyAllLate(correction_, &map_));
  EXPECT_LT(off_m(*map_.findPosed(5)->T_w_m, at(5.0)), 1e-9);
}

TEST_F(LateCorrectionTest, NothingIsDoneInAnotherWorld) {
  map_.beginEpoch();
  EXPECT_FALSE(applyAllLate(correction_, &map_));
  EXPECT_EQ(map_.findPosed(1)->T_w_m->p, at(1.0).p);
  EXPECT_EQ(poseOf(newest_).p, at(0.5).p);
}

}  // namespace
}  // namespace waymark::slam
