#include "base/task.h"

#include <memory>
#include <vector>

#include <gtest/gtest.h>

namespace waymark {
namespace {

Task<int> count(int to, Budget* budget, std::vector<int>* seen) {
  for (int i = 1; i <= to; ++i) {
    co_await budget->spend(1.0);
    seen->push_back(i);
  }
  co_return to;
}

Task<int> countTwice(int to, Budget* budget, std::vector<int>* seen) {
  const int first = co_await count(to, budget, seen);
  const int second = co_await count(to, budget, seen);
  co_return first + second;
}

TEST(Task, IsDoneInOneGo) {
  std::vector<int> seen;
  EXPECT_EQ(runToCompletion([&](Budget* budget) { return countTwice(3, budget, &seen); }), 6);
  EXPECT_EQ(seen, (std::vector<int>{1, 2, 3, 1, 2, 3}));
}

TEST(Task, IsPutAsideWhereNothingIsLeft) {
  std::vector<int> seen;
  SlicedTask<int> task([&](Budget* budget) { return countTwice(3, budget, &seen); });
  EXPECT_TRUE(seen.empty()) << "begins with the first slice";
  EXPECT_FALSE(task.advance(2.0));
  EXPECT_EQ(seen, (std::vector<int>{1}));
  EXPECT_FALSE(task.advance(2.0));
  EXPECT_EQ(seen, (std::vector<int>{1, 2, 3}));
  EXPECT_TRUE(task.advance(100.0));
  EXPECT_EQ(seen.size(), 6U);
  EXPECT_EQ(task.take(), 6);
}

// A step that costs more than a slice is done, and the next slices make up for it.
TEST(Task, OwesWhatWasOverspent) {
  int steps = 0;
  SlicedTask<int> task([&](Budget* budget) -> Task<int> {
    return [](Budget* a, int* done) -> Task<int> {
      for (int i = 0; i < 3; ++i) {
        co_await a->spend(5.0);
        ++*done;
      }
      co_return 0;
    }(budget, &steps);
  });
  std::vector<int> after;
  while (!task.advance(2.0)) after.push_back(steps);
  // 15 units at 2 a slice.
  EXPECT_EQ(after, (std::vector<int>{0, 0, 1, 1, 1, 2, 2}));
  EXPECT_EQ(steps, 3);
}

TEST(Task, GivesBackWhatItHoldsWhenItIsDropped) {
  const auto held = std::make_shared<int>(1);
  {
    SlicedTask<int> task([&](Budget* budget) -> Task<int> {
      return [](Budget* a, std::shared_ptr<int> own) -> Task<int> {
        for (;;) co_await a->spend(static_cast<double>(*own));
      }(budget, held);
    });
    EXPECT_FALSE(task.advance(3.0));
    EXPECT_EQ(held.use_count(), 2);
  }
  EXPECT_EQ(held.use_count(), 1);
}

}  // namespace
}  // namespace waymark
