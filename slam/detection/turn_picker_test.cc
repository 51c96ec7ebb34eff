#include "slam/detection/turn_picker.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
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

// How many turns it takes until all of 1,000 were picked, 20 of each 40 in turn. `miscounted`: up
// to so many more there are from turn to turn, as in images with noise.
int turnsForAll(std::uint32_t first_turn, std::size_t miscounted) {
  constexpr std::size_t kCount = 1000;
  TurnPicker picker(0.5);
  std::set<std::uint32_t> seen;
  for (std::uint32_t turn = 0; turn < 1000; ++turn) {
    std::vector<float> promise(kCount + turn * 7 % (miscounted + 1), 0.0F);
    for (std::size_t i = 0; i < 20; ++i) promise[i] = 1.0F;  // always the same
    const auto picked = picker.pick(promise, 40, first_turn + turn);
    std::ranges::copy_if(picked, std::inserter(seen, seen.end()),
                         [](std::uint32_t i) { return i < kCount; });
    if (seen.size() == kCount) return static_cast<int>(turn) + 1;
  }
  return 1000;
}

TEST(TurnPicker, EveryPlaceHasItsTurn) {
  constexpr int kLeast = 49;  // of 20 for 980
  for (const std::uint32_t first : {0U, 1U, 1000U, 4'000'000'000U, 4'294'967'290U}) {
    EXPECT_GE(turnsForAll(first, 0), kLeast);
    EXPECT_LE(turnsForAll(first, 0), 2 * kLeast) << "from turn " << first;
    EXPECT_LE(turnsForAll(first, 5), 2 * kLeast) << "from turn " << first;
  }
}

TEST(TurnPicker, AllOfThemMayBePickedByPromiseOrAllInTurn) {
  const auto promise = promises(1000);
  TurnPicker by_promise(0.0);
  const auto first = by_promise.pick(promise, 40, 0);
  const std::vector<std::uint32_t> best(first.begin(), first.end());
  EXPECT_TRUE(std::ranges::all_of(best, [&](auto i) { return promise[i] >= 960.0F; }));
  EXPECT_TRUE(std::ranges::equal(by_promise.pick(promise, 40, 17), best)) << "in every turn";
  TurnPicker in_turn(1.0);
  const auto some = in_turn.pick(promise, 40, 0);
  const std::vector<std::uint32_t> once(some.begin(), some.end());
  const auto others = in_turn.pick(promise, 40, 1);
  EXPECT_EQ(others.size(), 40U);
  EXPECT_TRUE(std::ranges::none_of(others, [&](auto i) {
    return std::ranges::binary_search(once, i);
  })) << "nothing twice in a row";
}

}  // namespace
}  // namespace waymark::slam
