#include "slam/options.h"

#include <functional>
#include <limits>
#include <string>

#include <gtest/gtest.h>

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
  expect([](Options* o) { o->initialization.two_frame.min_baseline_m = 0.0; },
         "the baseline of two frames must be positive");
  expect([](Options* o) { o->tracking.relocalization.ambiguity_ratio = 0.0; },
         "ambiguity ratios must be at least 1");
  expect([](Options* o) { o->mapper.keyframes.min_baseline_m = 0.0; },
         "keyframe distances must be positive");
  expect([](Options* o) { o->mapper.keyframes.views_per_marker = 1; },
         "views per marker must be at least 2");
  expect([](Options* o) { o->mapper.marker_pose.min_views = 1; },
         "a marker needs at least 2 views to be resolved");
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
}

}  // namespace
}  // namespace waymark::slam
