// A filter that runs takes no memory from the heap, with a counting operator new.
#include <vector>

#include <gtest/gtest.h>

#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/natural/filter/visual_filter.h"
#include "slam/testing/counting_new.h"

namespace waymark::slam {
namespace {

using waymark::testing::allocations;

TEST(FilterAllocation, ARunningFilterTakesNone) {
  const CameraModel camera(testing::wideCalibration(320, 240));
  testing::TexturedWall wall(3);
  const testing::Dolly dolly{.speed_m_per_s = 0.5, .seed = 3};
  VisualFilterOptions options;
  VisualFilter filter(options);
  filter.reinitialize(dolly.at(0.0), Matrix6d(1e-6 * Matrix6d::Identity()));
  std::vector<std::uint8_t> pixels;
  int taken = 0;
  int added = 0;
  for (int k = 0; k < 120; ++k) {
    wall.render(camera, dolly.at(k / 30.0), 2.0, static_cast<unsigned>(k), &pixels);
    const int before = allocations;
    if (k > 0) filter.predict(1.0 / 30.0);
    const VisualUpdate update = filter.update({pixels.data(), 320, 240, 320}, camera, {});
    filter.filter().markPast(static_cast<std::uint64_t>(k));
    if (k < 30) continue;
    taken += allocations - before;
    added += update.added;
  }
  EXPECT_EQ(taken, 0);
  EXPECT_GT(added, 10) << "not what was to be measured";
}

}  // namespace
}  // namespace waymark::slam
