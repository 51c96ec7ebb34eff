#include "slam/camera/lens_estimator.h"

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera/testing_lens_estimator.h"
#include "slam/testing/lens_scene.h"

namespace waymark::slam {
namespace {

using testing::kBundle;
using testing::kSigma_px;
using testing::LensEstimatorTest;
using testing::shifted;

TEST_F(LensEstimatorTest, LearnsAWrongLensOverSlices) {
  see(shifted(truth_, -0.02, -0.05, 8.0));
  LensOptions options;
  options.urgent_cost = 0.0;
  LensEstimator estimator = this->estimator(options);
  EXPECT_FALSE(estimator.idle(map_)) << "it is due";
  EXPECT_GT(workUntilDone(50.0, &estimator), 20);
  EXPECT_GT(std::abs(focalError()), 0.019) << "not before it is collected";
  const std::uint64_t epoch = map_.epoch();
  ASSERT_TRUE(estimator.collect(shutter_, kBundle, &map_));
  EXPECT_LT(std::abs(focalError()), 1e-3);
  EXPECT_EQ(knowledge_.state, LensState::kLearned);
  EXPECT_EQ(knowledge_.changes, 1);
  EXPECT_GT(knowledge_.rms_before_px, 10.0 * knowledge_.rms_after_px);
  EXPECT_NEAR(knowledge_.rms_after_px, std::sqrt(2.0) * kSigma_px, 0.02);
  EXPECT_GT(map_.epoch(), epoch) << "what is under way elsewhere is of no use any more";
  const MarkerDetection& detection = map_.keyframes().at(3).detections.front();
  EXPECT_LT((camera_.distort(detection.normalized[0]) - detection.pixels[0]).norm(), 1e-6)
      << "the corners are undistorted by the new lens";
  EXPECT_TRUE(estimator.idle(map_)) << "until the map has grown";
}

// Estimated from a part of a map: lens and map go on as they are, which belong together, until all
// of the map has been optimized through it.
TEST_F(LensEstimatorTest, LensAndMapChangeTogether) {
  see(shifted(truth_, -0.02, -0.05, 8.0));
  LensOptions options;
  options.max_keyframes = 8;
  LensEstimator estimator = this->estimator(options);
  const CameraModel before = camera_;
  const Map map_before = map_;
  (void)workUntilDone(kUnlimited, &estimator);
  EXPECT_FALSE(estimator.collect(shutter_, kBundle, &map_)) << "of a part of the map";
  EXPECT_EQ(camera_.calibration(), before.calibration());
  EXPECT_EQ(map_.epoch(), map_before.epoch());
  EXPECT_TRUE(estimator.inDoubt(map_));
  EXPECT_FALSE(estimator.idle(map_));
  (void)workUntilDone(kUnlimited, &estimator);
  ASSERT_TRUE(estimator.collect(shutter_, kBundle, &map_));
  EXPECT_LT(std::abs(focalError()), 0.002);
  EXPECT_FALSE(estimator.inDoubt(map_));
  // Every view fits at once.
  for (const auto& [id, keyframe] : map_.keyframes()) {
    for (const MarkerDetection& seen : keyframe.detections) {
      const Transform T_c_m = keyframe.T_w_c.inverse() * *map_.findPosed(seen.id)->T_w_m;
      const auto corners = markerCorners(testing::kLensSceneSize);
      for (std::size_t k = 0; k < corners.size(); ++k) {
        const auto expected = camera_.project(T_c_m * corners[k]);
        ASSERT_TRUE(expected);
        EXPECT_LT((*expected - seen.pixels[k]).norm(), 6.0 * kSigma_px) << id << ' ' << seen.id;
      }
    }
  }
}

// What joins while it is being estimated goes where the newest keyframe of then goes.
TEST_F(LensEstimatorTest, WhatJoinsMeanwhileMovesAlong) {
  see(shifted(truth_, -0.02, -0.05, 8.0));
  LensOptions options;
  options.urgent_cost = 0.0;
  LensEstimator estimator = this->estimator(options);
  estimator.work(50.0, shutter_, map_, kBundle);
  ASSERT_FALSE(estimator.isDone());
  const Keyframe newest = map_.keyframes().rbegin()->second;
  const Keyframe late = map_.keyframes().at(map_.addKeyframe(newest));
  (void)workUntilDone(50.0, &estimator);
  ASSERT_TRUE(estimator.collect(shutter_, kBundle, &map_));
  const Transform& T_now = map_.keyframes().at(late.id).T_w_c;
  EXPECT_GT((T_now.p - late.T_w_c.p).norm(), 1e-4);
  EXPECT_LT((T_now.p - map_.keyframes().at(newest.id).T_w_c.p).norm(), 1e-9);
}

// Another world by then, say after a loop: nothing is put into it, and the lens is asked for again.
TEST_F(LensEstimatorTest, ALensOfAWorldThatIsNoMoreIsEstimatedAgain) {
  see(shifted(truth_, -0.02, -0.05, 8.0));
  LensOptions options;
  options.max_keyframes = 8;
  LensEstimator estimator = this->estimator(options);
  (void)workUntilDone(kUnlimited, &estimator);
  EXPECT_FALSE(estimator.collect(shutter_, kBundle, &map_));
  map_.beginEpoch();
  const CameraModel before = camera_;
  (void)workUntilDone(kUnlimited, &estimator);
  EXPECT_FALSE(estimator.collect(shutter_, kBundle, &map_));
  EXPECT_EQ(camera_.calibration(), before.calibration());
  EXPECT_FALSE(estimator.idle(map_));
  (void)workUntilDone(kUnlimited, &estimator);
  (void)estimator.collect(shutter_, kBundle, &map_);
  (void)workUntilDone(kUnlimited, &estimator);
  EXPECT_TRUE(estimator.collect(shutter_, kBundle, &map_));
  EXPECT_LT(std::abs(focalError()), 0.002);
}

// What the first views have told is not kept because the later ones do not contradict it.
TEST_F(LensEstimatorTest, ALensThatIsBetterKnownReplacesTheOneBefore) {
  see(shifted(truth_, -0.02, -0.05, 8.0));
  LensEstimator estimator = this->estimator();
  ASSERT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_));
  EXPECT_FALSE(estimator.estimateNow(shutter_, kBundle, &map_)) << "the same views again";
  const IntrinsicMatrix known = knowledge_.covariance;
  knowledge_.covariance *= 4.0;  // as of a quarter of them
  ASSERT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_));
  EXPECT_EQ(knowledge_.changes, 2);
  EXPECT_NEAR(knowledge_.covariance(0, 0), known(0, 0), 0.1 * known(0, 0));
}

TEST_F(LensEstimatorTest, ARightLensStaysAsItWasGiven) {
  for (int seed = 0; seed < 20; ++seed) {
    rng_.seed(static_cast<unsigned>(seed));
    see(truth_);
    LensEstimator estimator = this->estimator();
    (void)workUntilDone(kUnlimited, &estimator);
    EXPECT_FALSE(estimator.collect(shutter_, kBundle, &map_)) << seed;
    EXPECT_EQ(camera_.calibration(), truth_.calibration());
    EXPECT_EQ(knowledge_.state, LensState::kGiven);
  }
}

// What it costs is counted in slices.
TEST_F(LensEstimatorTest, ARightLensIsSoonSeenToBeRight) {
  see(truth_);
  LensOptions options;
  options.urgent_cost = 0.0;
  LensEstimator estimator = this->estimator(options);
  const int of_right = workUntilDone(1.0, &estimator);
  options.agrees_chi2 = 0.0;
  LensEstimator thorough = this->estimator(options);
  const int of_all = workUntilDone(1.0, &thorough);
  EXPECT_LT(3 * of_right, of_all);
  EXPECT_FALSE(estimator.inDoubt(map_));
  EXPECT_FALSE(estimator.collect(shutter_, kBundle, &map_));
  EXPECT_EQ(knowledge_.state, LensState::kGiven);
}

TEST_F(LensEstimatorTest, IsOffWhereTheCalibrationIsExact) {
  see(shifted(truth_, -0.02, -0.05, 8.0));
  LensOptions options;
  options.learn = false;
  LensEstimator estimator = this->estimator(options);
  EXPECT_TRUE(estimator.idle(map_));
  EXPECT_FALSE(estimator.estimateNow(shutter_, kBundle, &map_));
}

// Through a wide lens the first squares say as little of the model as of the focal length. What the
// wrong model finds from there fits, but bends back within the image: it is no lens.
TEST_F(LensEstimatorTest, AWideLensIsFoundThatWasTakenForAUsualOne) {
  truth_ = testing::wideLens();
  LensOptions options;
  options.takeForGuess(/*fov_said=*/false);
  for (int seed = 0; seed < 10; ++seed) {
    rng_.seed(static_cast<unsigned>(seed));
    LensKnowledge at_first = knowledge_;
    see(testing::wideLensAtFirst(&at_first));
    knowledge_ = at_first;
    LensEstimator estimator = this->estimator(options);
    ASSERT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_)) << seed;
    EXPECT_EQ(camera_.calibration().model, DistortionModel::kEquidistant) << seed;
    EXPECT_LT(std::abs(focalError()), 0.01) << seed;
  }
}

// Over many lenses drawn as the prior has it, the error is what the covariance says.
TEST_F(LensEstimatorTest, IsAsWrongAsItSays) {
  constexpr int kRuns = 60;
  const LensOptions options;
  double nees = 0.0;
  for (int seed = 0; seed < kRuns; ++seed) {
    rng_.seed(static_cast<unsigned>(seed));
    LensPrior nearer = options.prior;
    nearer.radial = 0.04;  // more may have no inverse
    nearer.higher_radial = 0.02;
    see(testing::drawnLens(truth_, nearer, &rng_));
    const auto found = runToCompletion([&](Budget* budget) {
      return estimateLens(map_, markers_, {camera_, camera_, nearer, 0.0, true, 1000}, kBundle,
                          budget);
    });
    ASSERT_TRUE(found) << seed;
    nees += lensChange(*found, truth_);
  }
  // Chi-square of 9 degrees of freedom, the mean of 60: within 3 of its standard deviations.
  const double sigma = std::sqrt(2.0 * 9.0 / kRuns);
  EXPECT_NEAR(nees / kRuns, 9.0, 3.0 * sigma);
}

// Measured to that share of the focal length; all else is known as well as any lens is.
CameraModel measured(const CameraModel& lens, double focal_share) {
  LensPrior prior;
  prior.focal_share = focal_share;
  prior.since_focal_share = prior.since_centre_share = 0.0;
  Calibration c = lens.calibration();
  c.covariance = prior.covariance(asUnmeasured(lens));
  return CameraModel(c);
}

// What a calibration says of itself counts as far as what is found does not contradict it.
TEST_F(LensEstimatorTest, AMeasuredLensIsHeldAsWellAsItWasMeasured) {
  const LensOptions options;
  see(measured(truth_, 1e-4));
  const auto estimated = [&](const CameraModel& expected) {
    return runToCompletion([&](Budget* budget) {
      return estimateLens(map_, markers_, {camera_, expected, options.prior, 0.0, true, 1000},
                          kBundle, budget);
    });
  };
  const auto found = estimated(camera_);
  const auto of_any = estimated(asUnmeasured(camera_));
  ASSERT_TRUE(found && of_any);
  EXPECT_LT(found->focalShare(), 0.9 * of_any->focalShare());
  const double sure = std::hypot(1e-4, options.prior.since_focal_share);
  EXPECT_LT(found->focalShare(), 1.01 * sure);
  // Twenty times as far off as it says.
  see(measured(shifted(truth_, 0.02, 0.0, 0.0), 1e-3));
  const auto corrected = estimated(camera_);
  ASSERT_TRUE(corrected);
  EXPECT_LT(std::abs(corrected->camera.calibration().fx - truth_.calibration().fx),
            3.0 * std::sqrt(corrected->covariance(0, 0)));
  LensEstimator estimator = this->estimator(options);
  EXPECT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_));
  EXPECT_LT(std::abs(focalError()), 1e-3);
}

// A focal length that is off by as much as its calibration says hardly shows in the residuals, and
// yet bends a map: the map's measurement takes its place, and nobody is told that it does not fit.
TEST_F(LensEstimatorTest, TheMapMeasuresAMeasuredLensBetter) {
  const CameraModel given = measured(shifted(truth_, 3e-3, 0.0, 0.0), 3e-3);
  see(given);
  LensEstimator estimator = this->estimator(LensOptions{});
  EXPECT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_));
  EXPECT_LT(knowledge_.focalShare(), 5e-4);
  EXPECT_LT(std::abs(focalError()), 3.0 * knowledge_.focalShare());
  EXPECT_GT(knowledge_.rms_after_px, LensOptions{}.material_rms * knowledge_.rms_before_px);
  EXPECT_TRUE(knowledge_.refines_given);
  // Of the same lens that nobody has measured so well, nothing of this is believed.
  see(asUnmeasured(given));
  EXPECT_FALSE(estimator.estimateNow(shutter_, kBundle, &map_));
  EXPECT_FALSE(knowledge_.refines_given);
}

// A part of the map spoke for another lens; all of it does not.
TEST_F(LensEstimatorTest, WhatAllOfTheMapDoesNotConfirmIsTakenBack) {
  see(truth_);
  LensEstimator estimator = this->estimator();
  const CameraModel other = shifted(truth_, 3e-4, 0.0, 0.0);
  knowledge_.adopt(other, knowledge_.covariance, 0.1, 0.05, LensPrior{}, 0.002);
  camera_ = other;
  undistortAgain(camera_, 0.0, &map_);
  EXPECT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_)) << "another lens is in use now";
  EXPECT_EQ(camera_.calibration(), truth_.calibration());
  EXPECT_EQ(knowledge_.state, LensState::kGiven);
  EXPECT_EQ(knowledge_.changes, 2);
  const MarkerDetection& seen = map_.keyframes().at(3).detections.front();
  EXPECT_EQ(seen.normalized[0], *truth_.undistort(seen.pixels[0]));
}

// What is told of both is of the same views.
TEST_F(LensEstimatorTest, WhatAllOfTheMapConfirmsIsToldOfAllOfIt) {
  see(shifted(truth_, -0.02, -0.05, 8.0));
  LensEstimator estimator = this->estimator();
  ASSERT_TRUE(estimator.estimateNow(shutter_, kBundle, &map_));
  knowledge_.rms_given_px = 0.01;  // of other views
  (void)estimator.estimateNow(shutter_, kBundle, &map_);
  EXPECT_EQ(knowledge_.state, LensState::kLearned);
  EXPECT_GT(knowledge_.rms_given_px, 3.0 * knowledge_.rms_after_px);
}

TEST_F(LensEstimatorTest, WhatACalibrationSaysOfItselfIsWhatIsKnownAtFirst) {
  const CameraModel lens = measured(truth_, 1e-3);
  const LensKnowledge known = LensKnowledge::of(lens, /*exact=*/false);
  EXPECT_EQ(known.state, LensState::kGiven);
  EXPECT_NEAR(known.focalShare(), 1e-3, 5e-4);
  EXPECT_EQ(known.calibrationOf(lens), lens.calibration());
  const LensKnowledge exact = LensKnowledge::of(lens, /*exact=*/true);
  EXPECT_EQ(exact.focalShare(), 0.0);
  EXPECT_EQ(LensKnowledge::of(truth_, false).focalShare(), 0.0);
}

// Markers on one plane, all seen frontally from one distance: nothing tells the focal length.
TEST_F(LensEstimatorTest, WhatTheSceneDoesNotTellStaysAsGiven) {
  std::vector<testing::SyntheticMarker> markers;
  for (int i = 0; i < 15; ++i) {
    const Eigen::Vector3d centre(0.4 * (i % 5) - 0.8, 3.0, 0.4 * (i / 5) - 0.4);
    markers.push_back({i, testing::markerFacing(centre, centre - Eigen::Vector3d::UnitY())});
  }
  std::vector<Transform> views;
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d eye(0.1 * (i - 4), 1.0, 0.05 * (i % 3));
    views.push_back(testing::lookAt(eye, eye + Eigen::Vector3d::UnitY()));
  }
  camera_ = shifted(truth_, 0.02, 0.0, 0.0);
  knowledge_ = {.given = camera_};
  map_ = testing::trueMap(truth_, views, markers, testing::kLensSceneSize, kSigma_px, &rng_);
  undistortAgain(camera_, 0.0, &map_);
  const LensOptions options;
  const auto found = runToCompletion([&](Budget* budget) {
    return estimateLens(map_, markers_, {camera_, camera_, options.prior, 0.0, true, 1000}, kBundle,
                        budget);
  });
  ASSERT_TRUE(found);
  const double sigma_px = std::sqrt(found->covariance(0, 0));
  EXPECT_GT(sigma_px, 0.01 * truth_.calibration().fx);
  EXPECT_LT(std::abs(found->camera.calibration().fx - truth_.calibration().fx), 3.0 * sigma_px);
}

// Scenes that leave most of a lens open.
struct Unobservable {
  const char* name;
  std::vector<testing::SyntheticMarker> markers;
  std::vector<Transform> views;
};

std::vector<testing::SyntheticMarker> flatWall() {
  std::vector<testing::SyntheticMarker> markers;
  for (int i = 0; i < 15; ++i) {
    const Eigen::Vector3d centre(0.4 * (i % 5) - 0.8, 3.0, 0.4 * (i / 5) - 0.4);
    markers.push_back({i, testing::markerFacing(centre, centre - Eigen::Vector3d::UnitY())});
  }
  return markers;
}

Unobservable flatSceneSeenFrontally() {
  Unobservable scene{"a flat scene seen frontally", flatWall(), {}};
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d eye(0.1 * (i - 4), 1.0, 0.05 * (i % 3));
    scene.views.push_back(testing::lookAt(eye, eye + Eigen::Vector3d::UnitY()));
  }
  return scene;
}

Unobservable turningBeforeOneFarMarker() {
  const Eigen::Vector3d centre(0.0, 4.0, 0.0);
  Unobservable scene{"a pure rotation with one far marker", {}, {}};
  scene.markers = {{0, testing::markerFacing(centre, {1.0, 0.0, 0.4})}};
  for (int i = 0; i < 9; ++i) {
    const double turn_rad = 0.07 * (i - 4);
    scene.views.push_back(testing::lookAt(Eigen::Vector3d::Zero(),
                                          {4.0 * std::sin(turn_rad), 4.0, 0.4 * (i % 3) - 0.4}));
  }
  return scene;
}

Unobservable stillCamera() {
  Unobservable scene{"a still camera", flatWall(), {}};
  const Eigen::Vector3d eye(0.0, 1.0, 0.0);
  scene.views.assign(6, testing::lookAt(eye, {0.3, 3.0, 0.1}));
  return scene;
}

// Of lenses that are as far off as the prior has it: each estimate ends, and each of its unknowns
// is as wrong as it says.
TEST_F(LensEstimatorTest, WhatTheSceneDoesNotTellIsHeldByThePrior) {
  constexpr int kRuns = 100;
  const LensOptions options;
  LensPrior prior = options.prior;
  prior.radial = 0.04;  // more may have no inverse
  prior.higher_radial = 0.02;
  for (const Unobservable& scene :
       {flatSceneSeenFrontally(), turningBeforeOneFarMarker(), stillCamera()}) {
    IntrinsicVector normalized = IntrinsicVector::Zero();  // errors, squared
    double nees = 0.0;
    double focal_sigma = 0.0;  // as a share
    for (int seed = 0; seed < kRuns; ++seed) {
      rng_.seed(static_cast<unsigned>(seed));
      camera_ = testing::drawnLens(truth_, prior, &rng_);
      map_ = testing::trueMap(truth_, scene.views, scene.markers, testing::kLensSceneSize,
                              kSigma_px, &rng_);
      undistortAgain(camera_, 0.0, &map_);
      const auto found = runToCompletion([&](Budget* budget) {
        return estimateLens(map_, markers_, {camera_, camera_, prior, 0.0, true, 1000}, kBundle,
                            budget);
      });
      ASSERT_TRUE(found) << scene.name << ", seed " << seed;
      const IntrinsicVector error = found->camera.intrinsics() - truth_.intrinsics();
      const IntrinsicVector variances = found->covariance.diagonal();
      ASSERT_LT(std::abs(error[0]), 0.25 * truth_.calibration().fx) << scene.name << ' ' << seed;
      normalized += error.cwiseAbs2().cwiseQuotient(variances) / kRuns;
      nees += lensChange(*found, truth_) / kRuns;
      focal_sigma += std::sqrt(variances[0]) / found->camera.focalLength() / kRuns;
    }
    std::printf("%s: focal length to %.2f %%, normalized %.2f, NEES of all nine %.2f\n", scene.name,
                100.0 * focal_sigma, normalized[0], nees);
    EXPECT_GT(focal_sigma, 0.04) << scene.name << ": the prior has it at 0.05";
    // The mean of 100 of chi-square of 1 is within these in all but one of 1,000.
    EXPECT_GT(normalized.minCoeff(), 0.60) << scene.name << ": " << normalized.transpose();
    EXPECT_LT(normalized.maxCoeff(), 1.50) << scene.name << ": " << normalized.transpose();
    // Where only the focal length is open, what goes with it is on a curve, not on a line.
    EXPECT_LT(nees, 1.5 * 9.0) << scene.name;
  }
}

}  // namespace
}  // namespace waymark::slam
