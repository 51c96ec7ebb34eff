#include "slam/camera/lens_evidence.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera/testing_lens_estimator.h"

namespace waymark::slam {
namespace {

using testing::kBundle;
using testing::kLensSceneSize;
using testing::lensScene;
using testing::shifted;

// Groups that cost 1 where the sum is least, half of them g more and half of them g less before it,
// and all h more on either side.
double chi2Of(std::size_t groups, double g, double h, std::size_t unseen = 0) {
  std::vector<double> before;
  std::vector<double> least;
  std::vector<double> beyond;
  for (std::size_t i = 0; i < groups; ++i) {
    const double slope = i % 2 == 0 ? g : -g;
    before.push_back(1.0 + slope + h);
    least.push_back(1.0);
    beyond.push_back(1.0 - slope + h);
  }
  for (std::vector<double>* costs : {&before, &least, &beyond}) costs->resize(groups + unseen, 0.0);
  return chi2ByGroups(before, least, beyond);
}

TEST(Chi2ByGroups, ErrorsOfTheGroupsAreTheNoise) {
  // 4 * 18 h / g^2 of the way's own cost, 18 h; half of the groups are the lens' unknowns.
  EXPECT_NEAR(chi2Of(18, 1.0, 0.5), 9.0, 1e-12);
  EXPECT_NEAR(chi2Of(18, 2.0, 0.5), 2.25, 1e-12);
  EXPECT_NEAR(chi2Of(36, 1.0, 0.5), 27.0, 1e-12);
}

TEST(Chi2ByGroups, FewTellNothing) {
  EXPECT_EQ(chi2Of(9, 1.0, 0.5), 0.0);
  EXPECT_GT(chi2Of(10, 1.0, 0.5), 0.0);
  EXPECT_EQ(chi2Of(9, 1.0, 0.5, /*unseen=*/20), 0.0);
  EXPECT_EQ(chi2Of(18, 1.0, 0.0), 0.0) << "no way";
}

class LensEvidenceTest : public testing::LensEstimatorTest {
 protected:
  // Through that lens, with so much noise; and each marker's paper bent by a share of its side, the
  // same in all views.
  void seeThrough(const CameraModel& lens, double sigma_px, double bent_share) {
    camera_ = lens;
    knowledge_ = {.given = lens};
    const Map flat = lensScene(truth_, sigma_px, &rng_);
    std::normal_distribution<double> bend(0.0, bent_share);
    std::map<int, std::array<Eigen::Vector2d, 4>> bends;
    for (const auto& [id, marker] : flat.markers()) {
      for (Eigen::Vector2d& corner : bends[id]) corner = {bend(rng_), bend(rng_)};
    }
    map_ = Map();
    for (const auto& [id, marker] : flat.markers()) {
      map_.addMarker(id, kLensSceneSize);
      map_.place(id, *marker.T_w_m);
    }
    for (const auto& [id, view] : flat.keyframes()) {
      Keyframe keyframe = view;
      std::vector<MarkerDetection> detections(view.detections.begin(), view.detections.end());
      for (MarkerDetection& seen : detections) {
        const Eigen::Vector2d right = seen.pixels[1] - seen.pixels[0];
        const Eigen::Vector2d down = seen.pixels[3] - seen.pixels[0];
        for (std::size_t k = 0; k < 4; ++k) {
          const Eigen::Vector2d& by = bends[seen.id][k];
          seen.pixels[k] += by.x() * right + by.y() * down;
        }
      }
      keyframe.detections = std::move(detections);
      (void)map_.addKeyframe(std::move(keyframe));
    }
    undistortAgain(camera_, 0.0, &map_);
  }
  [[nodiscard]] LensEstimate estimateHere() const {
    const LensProblem problem{.in_use = camera_,
                              .expected = knowledge_.given,
                              .readout_known = true,
                              .contradicts_chi2 = LensOptions{}.min_chi2};
    return *runToCompletion(
        [&](Budget* budget) { return estimateLens(map_, markers_, problem, kBundle, budget); });
  }
};

// A little of focal length makes little of the corners' errors, and shows in all of them.
TEST_F(LensEvidenceTest, WhatIsALittleWrongEverywhereIsLearned) {
  const LensOptions options;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    rng_.seed(seed);
    seeThrough(shifted(truth_, 0.007, 0.0, 0.0), 0.05, 0.0);
    const LensEstimate estimate = estimateHere();
    EXPECT_GT(estimate.rms_after_px, options.material_rms * estimate.rms_before_px) << seed;
    EXPECT_GT(estimate.evidence.chi2(), options.min_chi2) << seed;
    LensEstimator estimator = this->estimator();
    EXPECT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_)) << seed;
    EXPECT_LT(std::abs(focalError()), 3.5 * knowledge_.focalShare()) << seed;
    // And what was learned is not taken back for that it makes little difference.
    (void)estimator.estimateNow(shutter_, kBundle, &map_);
    EXPECT_NE(knowledge_.state, LensState::kGiven) << seed;
  }
}

// Paper that is not flat looks like another lens to a chi-square that takes each corner for news.
TEST_F(LensEvidenceTest, BentPaperIsNoLens) {
  int contradicted = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    rng_.seed(seed);
    seeThrough(truth_, 0.05, 0.02);
    const LensEstimate estimate = estimateHere();
    contradicted += lensChange(estimate, camera_) > LensOptions{}.min_chi2 ? 1 : 0;
    EXPECT_LT(estimate.evidence.chi2(), 0.5 * LensOptions{}.min_chi2) << seed;
    LensEstimator estimator = this->estimator();
    EXPECT_FALSE(estimator.estimateNow(shutter_, kBundle, &map_)) << seed;
    EXPECT_EQ(knowledge_.state, LensState::kGiven) << seed;
  }
  EXPECT_GE(contradicted, 5) << "or there is nothing to tell apart";
}

}  // namespace
}  // namespace waymark::slam
