#include "slam/detection/turn_picker.h"

#include <algorithm>
#include <set>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

std::vector<float> promises(std::size_t count) {
  std::vector<float> promise(count);
  for (std::size_t i = 0; i < count; ++i) promise[i] = static_cast<float>(i * 7 % count);
  return promise;
}

TEST(TurnPicker, TakesAllWhereThereIsRoom) {
  TurnPicker picker(0.5);
  const auto picked = picker.pick(promises(5), 5, 3);
  EXPECT_EQ(std::vector<std::uint32_t>(picked.begin(), picked.end()),
            (std::vector<std::uint32_t>{0, 1, 2, 3, 4}));
  EXPECT_TRUE(picker.pick({}, 5, 3).empty());
  EXPECT_TRUE(picker.pick(promises(5), 0, 3).empty());
}

TEST(TurnPicker, TheMostPromisingAreAlwaysAmongThem) {
  TurnPicker picker(0.5);
  const auto promise = promises(1000);
  for (std::uint32_t turn = 0; turn < 50; ++turn) {
    const auto picked = picker.pick(promise, 40, turn);
    EXPECT_EQ(picked.size(), 40U);
    EXPECT_TRUE(std::ranges::is_sorted(picked));
    EXPECT_EQ(std::set<std::uint32_t>(picked.begin(), picked.end()).size(), 40U) << "none twice";
    // 20 by promise.
    EXPECT_GE(std::ranges::count_if(picked, [&](auto i) { return promise[i] >= 980.0F; }), 20);
  }
}

// Also for those who only come to every twelfth turn.
TEST(TurnPicker, EveryPlaceHasItsTurn) {
  for (const std::uint32_t step : {1U, 2U, 7U, 12U, 48U}) {
    TurnPicker picker(0.5);
    const std::vector<float> promise(1000, 0.0F);
    std::set<std::uint32_t> seen;
    constexpr int kFair = 50;  // turns of 20 for 1,000
    int turns = 0;
    for (std::uint32_t turn = 1; seen.size() < promise.size() && turns < 10 * kFair; turn += step) {
      const auto picked = picker.pick(promise, 40, turn);
      seen.insert(picked.begin(), picked.end());
      ++turns;
    }
    EXPECT_LE(turns, 4 * kFair) << "every " << step;
  }
}

}  // namespace
}  // namespace waymark::slam
