#include "slam/options.h"

#include <functional>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "slam/frame_work.h"

namespace waymark::slam {
namespace {

// What is wrong with usable options after a change.
std::string reasonAfter(const std::function<void(Options*)>& change) {
  Options options;
  options.markers.size_m = 0.1;
  change(&options);
  return options.invalidReason();
}

TEST(Options, TheDefaultsAreUsable) {
  EXPECT_EQ(reasonAfter([](Options*) {}), "");
  EXPECT_EQ(reasonAfter([](Options* o) { o->treatAsUnorderedImages(); }), "");
  EXPECT_EQ(reasonAfter([](Options* o) { o->global_optimization.view_chi2 = 0.0; }), "")
      << "no gate";
}

TEST(Options, EveryStageIsAsked) {
  const auto expect = [](const std::function<void(Options*)>& change, const std::string& reason) {
    EXPECT_EQ(reasonAfter(change), reason);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  expect([](Options* o) { o->markers.size_m = 0.0; },
         "the marker size must be a positive number of metres");
  expect([](Options* o) { o->detector.rejected_frames = -1; },
         "the frames of a rejected square must not be negative");
  expect([](Options* o) { o->detector.budget.candidates = -1; },
         "the candidates of a frame must not be negative");
  expect([](Options* o) { o->detector.budget.turn_share = 1.5; },
         "the shares of what has its turn and of what comes first must be from 0 to 1");
  expect([](Options* o) { o->detector.scanner.same_corner_px = 0.0; },
         "the distance of same corners must be positive");
  expect([](Options* o) { o->detector.scanner.strict.share = 1.0; },
         "the share of a dark pixel's threshold must be 0 to less than 1");
  expect([](Options* o) { o->detector.scanner.lenient.offset = -1.0; },
         "the offset of a dark pixel's threshold must not be negative");
  expect([](Options* o) { o->detector.scanner.regions.min_extent_px = 0; },
         "the least extent of a region must be at least 1 pixel");
  expect([&](Options* o) { o->detector.scanner.quads.min_side_px = nan; },
         "the shortest side must be positive");
  expect([](Options* o) { o->detector.edges.passes = 0; }, "a side needs at least 1 fit");
  expect([](Options* o) { o->detector.edges.window.max_end = 0.5; },
         "a side's window must leave out less than all of it");
  expect([](Options* o) { o->detector.edges.fit.max_blur_px = 0.1; },
         "the range of an edge's blur must be positive");
  expect([](Options* o) { o->detector.decoder.max_wrong_bits = -1; },
         "the number of wrong bits must not be negative");
  expect([](Options* o) { o->detector.decoder.min_likeness = 1.5; },
         "the least likeness of a marker must be from 0 to 1");
  expect([](Options* o) { o->follower.min_found = 1.5; },
         "the share of markers found again must be from 0 to 1");
  expect([](Options* o) { o->follower.schedule.round_s = 0.0; },
         "the time of a round must be positive");
  expect([](Options* o) { o->follower.border.dark_sixteenths = 17; },
         "dark pixels must be below 1 to 16 sixteenths of the mean");
  expect([](Options* o) { o->initialization.ambiguity_ratio = 0.5; },
         "ambiguity ratios must be at least 1");
  expect([](Options* o) { o->initialization.attempts = 0; },
         "initialization needs at least 1 attempt");
  expect([](Options* o) { o->initialization.min_likeness = -0.1; },
         "the likeness of a marker that starts a map must be from 0 to 1");
  expect([](Options* o) { o->initialization.two_frame.min_baseline_m = 0.0; },
         "the baseline of two frames must be positive");
  expect([](Options* o) { o->tracking.min_witnesses = 0; },
         "a marker that disagrees needs at least 1 witness");
  expect([](Options* o) { o->mapper.keyframes.min_baseline_m = 0.0; },
         "keyframe distances must be positive");
  expect([](Options* o) { o->mapper.keyframes.views_per_marker = 1; },
         "views per marker must be at least 2");
  expect([](Options* o) { o->mapper.local_optimization.max_iterations = 0; },
         "an optimization needs at least 1 iteration");
  expect([](Options* o) { o->loops.ambiguity_floor = -1.0; },
         "the floor of a loop's ambiguity must not be negative");
  expect([](Options* o) { o->loops.pose_graph.radians_per_metre = 0.0; },
         "the weight of a metre in a pose graph must be positive");
  expect([](Options* o) { o->loops.optimization.huber = 0.0; },
         "Huber's threshold must be positive");
  expect([](Options* o) { o->screening.doubled_frames = 0; },
         "a doubled marker needs at least 1 frame");
  expect([](Options* o) { o->shutter.max_s = 0.001; }, "the range of readout times is empty");
  expect([](Options* o) { o->global_optimization.max_gated_share = 2.0; },
         "the share of gross views must be from 0 to 1");
  expect([](Options* o) { o->intrinsics.focal_px = -1.0; },
         "the sigmas of the intrinsics must not be negative");
  expect([](Options* o) { o->work_per_frame = 0.0; }, "the work of a frame must be positive");
  expect([](Options* o) { o->spare_time_share = 1.5; },
         "the share of a slow camera's time must be from 0 to 1");
  expect([](Options* o) { o->most_work_per_frame = 0.0; },
         "the most work of a frame must be positive");
}

TEST(Options, OfTheSquaresPoseWhereverItIsUsed) {
  const auto expect = [](const std::function<void(SquarePoseOptions*)>& change,
                         const std::string& reason) {
    EXPECT_EQ(reasonAfter([&](Options* o) { change(&o->initialization.square); }), reason);
    EXPECT_EQ(reasonAfter([&](Options* o) { change(&o->initialization.two_frame.square); }),
              reason);
    EXPECT_EQ(reasonAfter([&](Options* o) { change(&o->tracking.relocalization.square); }), reason);
    EXPECT_EQ(reasonAfter([&](Options* o) { change(&o->mapper.marker_pose.square); }), reason);
  };
  expect([](SquarePoseOptions* o) { o->systematic_sigma_px = -0.1; },
         "the systematic error of a corner must not be negative");
  expect([](SquarePoseOptions* o) { o->evidence_floor = -1.0; },
         "the floor of the evidence must not be negative");
  expect([](SquarePoseOptions* o) { o->refinement_iterations = 0; },
         "a square's pose needs at least 1 iteration");
  expect([](SquarePoseOptions* o) { o->same_rotation_rad = -0.01; },
         "the turn of the same solution must not be negative");
  expect([](SquarePoseOptions* o) { o->unseen_chi2 = 0.0; },
         "the chi-square of an unseen marker must be positive");
}

TEST(Options, OfTheCamerasPose) {
  const auto expect = [](const std::function<void(TrackerOptions*)>& change,
                         const std::string& reason) {
    EXPECT_EQ(reasonAfter([&](Options* o) { change(&o->tracking); }), reason);
  };
  expect([](TrackerOptions* o) { o->pose.max_iterations = 0; },
         "a camera's pose needs at least 1 iteration");
  expect([](TrackerOptions* o) { o->pose.huber = 0.0; }, "Huber's threshold must be positive");
  expect([](TrackerOptions* o) { o->pose.marker_chi2 = 0.0; },
         "the chi-square of a marker must be positive");
  expect([](TrackerOptions* o) { o->pose.min_gated_markers = 2; },
         "the gate of markers needs at least 3 of them");
  expect([](TrackerOptions* o) { o->pose.inlier_rms_px = -1.0; },
         "the residuals of a marker that fits must not be negative");
  expect([](TrackerOptions* o) { o->pose.max_rms_px = 0.0; },
         "the largest residuals of a pose must be positive");
  expect([](TrackerOptions* o) { o->pose.min_inlier_share = 1.5; },
         "the share of markers that fit must be from 0 to 1");
  expect([](TrackerOptions* o) { o->motion.max_age_s = -1.0; },
         "the gaps that a motion outlasts must not be negative");
  expect([](TrackerOptions* o) { o->motion.acceleration_sigma = -1.0; },
         "the sigmas of accelerations must not be negative");
  expect([](TrackerOptions* o) { o->motion.velocity_sigma = -1.0; },
         "the sigmas of velocities must not be negative");
  expect([](TrackerOptions* o) { o->relocalization.ambiguity_ratio = 0.0; },
         "ambiguity ratios must be at least 1");
  expect([](TrackerOptions* o) { o->relocalization.other_rotation_rad = -0.1; },
         "the turn to another pose must not be negative");
  expect([](TrackerOptions* o) { o->relocalization.max_marker_chi2 = 0.0; },
         "the largest chi-square of a marker must be positive");
  expect([](TrackerOptions* o) { o->relocalization.min_inlier_share = -0.5; },
         "the share of markers that agree must be from 0 to 1");
  expect([](TrackerOptions* o) { o->max_innovation_per_rms = -0.5; },
         "the innovation of a believed marker must not be negative");
  expect([](TrackerOptions* o) { o->ambiguity_floor = -1.0; },
         "the floor of a pose's ambiguity must not be negative");
}

TEST(Options, OfTheMapsGrowth) {
  const auto expect = [](const std::function<void(Options*)>& change, const std::string& reason) {
    EXPECT_EQ(reasonAfter(change), reason);
  };
  expect([](Options* o) { o->initialization.two_frame.other_rotation_rad = -0.1; },
         "the turn to another pose must not be negative");
  expect([](Options* o) { o->mapper.keyframes.unknown_depth_m = 0.0; },
         "the distance of unknown markers must be positive");
  expect([](Options* o) { o->mapper.marker_pose.min_views = 1; },
         "a marker needs at least 2 views to be resolved");
  expect([](Options* o) { o->mapper.marker_pose.ambiguity_ratio = 0.5; },
         "ambiguity ratios must be at least 1");
  expect([](Options* o) { o->mapper.marker_pose.final_ratio = 0.5; },
         "ambiguity ratios must be at least 1");
  expect([](Options* o) { o->mapper.marker_pose.other_rotation_rad = -0.1; },
         "the turn to another pose must not be negative");
  expect([](Options* o) { o->mapper.marker_pose.max_chi2_per_view = 0.0; },
         "the chi-square of a view must be positive");
  expect([](Options* o) { o->mapper.marker_pose.refinement_iterations = 0; },
         "a marker's pose needs at least 1 iteration");
  expect([](Options* o) { o->mapper.work_share = 1.5; },
         "the share of local optimization must be from 0 to 1");
  expect([](Options* o) { o->mapper.second_look_views = 1; },
         "a second look at a marker needs at least 2 views");
  expect([](Options* o) { o->mapper.most_views = 2; },
         "a marker must be decided from at least 3 views");
  expect([](Options* o) { o->loops.min_joining_share = -0.1; },
         "the share of a loop's markers must be from 0 to 1");
  expect([](Options* o) { o->loops.frames_between_attempts = -1; },
         "the frames between loop closures must not be negative");
  expect([](Options* o) { o->loops.min_witnesses = 0; },
         "a marker that disagrees needs at least 1 witness");
  expect([](Options* o) { o->loops.other_rotation_rad = -0.1; },
         "the turn to another pose must not be negative");
  expect([](Options* o) { o->shutter.min_change_sigmas = -1.0; },
         "the sigmas of a readout time must not be negative");
  expect([](Options* o) { o->shutter.unknown_s = -1.0; },
         "the sigma of an unknown readout time must not be negative");
  expect([](Options* o) { o->covariance.repeated_share = 1.5; },
         "the repeated share of a corner's error must be from 0 to 1");
  expect([](Options* o) { o->global_optimization.gate_after = 1.5; },
         "the iterations before the gate must be a share from 0 to 1");
}

// Nothing more at the usual rates, or where a frame was late; the time that a slow camera leaves,
// up to a bound, however long nothing came.
TEST(FrameWork, ASlowCameraLeavesTime) {
  Options options;
  EXPECT_EQ(frameWork(options, 0.0), options.work_per_frame);
  EXPECT_EQ(frameWork(options, 1.0 / 150.0), options.work_per_frame);
  EXPECT_EQ(frameWork(options, 1.0 / 30.0), options.work_per_frame);
  EXPECT_NEAR(frameWork(options, 1.0 / 30.0 + 0.1), options.work_per_frame + 3000.0, 1e-6);
  EXPECT_EQ(frameWork(options, 1000.0), options.most_work_per_frame);
  EXPECT_EQ(frameWork(options, -1.0), options.work_per_frame);
  options.spare_time_share = 0.0;
  EXPECT_EQ(frameWork(options, 0.5), options.work_per_frame);
  options.treatAsUnorderedImages();
  EXPECT_EQ(frameWork(options, 0.5), options.work_per_frame) << "there is no bound";
}

}  // namespace
}  // namespace waymark::slam
