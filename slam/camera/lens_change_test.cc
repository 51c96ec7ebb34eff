#include "slam/camera/lens_change.h"

#include <cstdint>
#include <utility>

#include <gtest/gtest.h>

#include "slam/camera/testing_lens_estimator.h"
#include "slam/camera/undistort_map.h"
#include "slam/testing/lens_scene.h"

namespace waymark::slam {
namespace {

using testing::kBundle;
using testing::kSigma_px;
using testing::shifted;

// The focus changed at the tenth of fourteen keyframes, which was noticed at the last.
class LensChangeTest : public testing::LensEstimatorTest {
 protected:
  static constexpr std::int64_t kSecond_ns = 1'000'000'000;
  static constexpr KeyframeId kChange = 9;

  LensChangeTest() {
    const auto first_rng = rng_;
    const Map before = testing::lensScene(truth_, kSigma_px, &rng_);
    rng_ = first_rng;
    const Map after = testing::lensScene(longer_, kSigma_px, &rng_);
    for (const auto& [id, marker] : before.markers()) {
      map_.addMarker(id, marker.size_m);
      map_.place(id, *marker.T_w_m);
    }
    for (KeyframeId k = 0; k < 14; ++k) {
      Keyframe keyframe = (k < kChange ? before : after).keyframes().at(k);
      keyframe.monotonic_ns = k * kSecond_ns;
      (void)map_.addKeyframe(std::move(keyframe));
    }
    camera_ = shifted(truth_, 0.027, 0.0, 0.0);  // about as it was found
    knowledge_.adopt(camera_, 0.01 * IntrinsicMatrix::Identity(), 1.0, 0.1, LensPrior{}, 0.002);
    noticedAt(13 * kSecond_ns);
  }

  void noticedAt(std::int64_t time_ns) {
    knowledge_.since_ns = time_ns;
    knowledge_.earlier = {{truth_, time_ns}};
    undistortAgain(truth_, 0.0, &map_);
    undistortAgain(camera_, 0.0, &map_, time_ns);
  }

  void expectDated() const {
    EXPECT_EQ(knowledge_.since_ns, kChange * kSecond_ns);
    EXPECT_EQ(knowledge_.earlier.back().until_ns, kChange * kSecond_ns);
    EXPECT_NEAR(camera_.calibration().fx / longer_.calibration().fx, 1.0, 1e-3);
    for (const KeyframeId k : {kChange - 1, kChange}) {
      const CameraModel& lens = k < kChange ? truth_ : camera_;
      const MarkerDetection& seen = map_.keyframes().at(k).detections.front();
      EXPECT_EQ(seen.normalized[0], *lens.undistort(seen.pixels[0])) << k;
    }
  }

  CameraModel longer_ = shifted(truth_, 0.03, 0.0, 0.0);
};

TEST_F(LensChangeTest, IsDatedAtTheEnd) {
  LensEstimator estimator = this->estimator();
  EXPECT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_));
  expectDated();
}

// What was taken for the new lens' is given back to the one before.
TEST_F(LensChangeTest, IsDatedLaterThanItWas) {
  noticedAt(8 * kSecond_ns);
  LensEstimator estimator = this->estimator();
  EXPECT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_));
  expectDated();
}

// And the map is optimized anew for it, in slices.
TEST_F(LensChangeTest, IsDatedWhileTheMapGrows) {
  LensEstimator estimator = this->estimator();
  int frames = 0;
  while (!estimator.idle(map_)) {
    ASSERT_LT(++frames, 1000);
    estimator.work(200.0, shutter_, map_, kBundle);
    if (estimator.isDone()) (void)estimator.collect(shutter_, kBundle, &map_);
  }
  EXPECT_GT(frames, 3) << "not in one go";
  expectDated();
  EXPECT_TRUE(knowledge_.earlier.back().dated);
}

// While one change is being dated the lens changes once more: the date is not that one's.
TEST_F(LensChangeTest, ADateIsOfTheChangeThatItWasAskedFor) {
  LensEstimator estimator = this->estimator();
  (void)workUntilDone(0.1, &estimator);
  ASSERT_TRUE(estimator.isDone());
  const std::int64_t again_ns = 20 * kSecond_ns;
  knowledge_.earlier.push_back({camera_, again_ns});
  knowledge_.since_ns = again_ns;
  EXPECT_FALSE(estimator.collect(shutter_, kBundle, &map_));
  EXPECT_EQ(knowledge_.since_ns, again_ns);
  EXPECT_FALSE(knowledge_.earlier.back().dated);
  EXPECT_FALSE(estimator.idle(map_)) << "it is still to be dated";
}

TEST_F(LensChangeTest, IsAsOldAsItWasNoticedWhereNothingTells) {
  noticedAt(kSecond_ns);  // nothing is known of the markers from before
  const auto date = runToCompletion([&](Budget* budget) {
    return dateChange(map_, {truth_, longer_, kSecond_ns}, markers_, kBundle, budget);
  });
  EXPECT_FALSE(date);
}

}  // namespace
}  // namespace waymark::slam
