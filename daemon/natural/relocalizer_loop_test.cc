#include "daemon/natural/relocalizer_loop.h"

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "slam/map/picture_print.h"
#include "slam/testing/seen_picture.h"
#include "slam/testing/synthetic.h"

namespace waymark::daemon {
namespace {

// However often it is asked. What its thread has run is counted, so that it does not matter what
// else keeps the machine busy.
TEST(RelocalizerLoop, TakesNoMoreThanItsShareOfACore) {
  using std::chrono::steady_clock;
  constexpr double kShare = 0.2;
  constexpr std::uint64_t kSearches = 3;
  constexpr double kWidth_m = 0.3;
  constexpr double kHeight_m = 0.225;
  cv::setNumThreads(1);  // as the daemon
  const cv::Mat poster = slam::testing::poster(102);
  const slam::testing::PictureScene scene{.camera =
                                              slam::CameraModel(slam::testing::testCalibration())};
  const cv::Mat image = slam::testing::seenPicture(scene, poster, kWidth_m, kHeight_m,
                                                   slam::testing::pictureAt(0.6, 0.5, 0.7, 0.3), 1);
  const int id = slam::pictureId("seen poster");
  std::vector<slam::PosedNaturalMarker> pictures;
  pictures.push_back(
      {id, slam::NaturalMarker::create(slam::testing::viewOf(poster), kWidth_m, 0.0).value(), {}});
  RelocalizerLink link({id}, image.cols, image.rows);
  RelocalizerLoop loop(std::move(pictures), link, {.core_share = kShare, .relocalizer = {}});
  std::thread thread([&] { loop.run(); });

  // The next search is asked for as soon as the loop has rested from the one before.
  const slam::Map map;
  const steady_clock::time_point begin = steady_clock::now();
  for (std::uint64_t i = 0; i < kSearches; ++i) {
    link.ask({.time = {i, static_cast<std::int64_t>(i)}, .image = slam::testing::viewOf(image)}, {},
             scene.camera, map, 1);
    while (!link.idle()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      (void)link.hear();
    }
  }
  const double elapsed_ms =
      std::chrono::duration<double, std::milli>(steady_clock::now() - begin).count();
  link.requestStop();
  thread.join();

  std::map<std::string, std::uint64_t> counters;
  loop.reportCounters([&](const char* name, std::uint64_t value) { counters[name] = value; });
  EXPECT_EQ(counters["relocalizer.searches"], kSearches);
  EXPECT_EQ(counters["relocalizer.located"], kSearches) << "not what was to be measured";
  const auto spent_ms = static_cast<double>(counters["relocalizer.cpu_ms"]);
  EXPECT_GT(spent_ms, 0.0);
  EXPECT_LE(spent_ms, kShare * elapsed_ms);
}

}  // namespace
}  // namespace waymark::daemon
