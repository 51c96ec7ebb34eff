#include "daemon/frames/triple_buffer.h"

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

TEST(TripleBuffer, GivesTheNewestOnceOnly) {
  TripleBuffer<int> buffer;
  EXPECT_EQ(buffer.take(), nullptr);
  buffer.writeBuffer() = 1;
  buffer.publish();
  buffer.writeBuffer() = 2;
  buffer.publish();
  const int* value = buffer.take();
  ASSERT_NE(value, nullptr);
  EXPECT_EQ(*value, 2);
  EXPECT_EQ(buffer.take(), nullptr);
}

TEST(TripleBuffer, ReaderSeesWholeValuesThatOnlyGrow) {
  TripleBuffer<std::vector<int>> buffer(std::vector<int>(64, 0));
  std::atomic<bool> done{false};
  std::thread writer([&] {
    for (int i = 1; i <= 50'000; ++i) {
      std::ranges::fill(buffer.writeBuffer(), i);
      buffer.publish();
    }
    done = true;
  });

  int last = 0;
  int torn = 0;
  int backwards = 0;
  for (bool finished = false; !finished;) {
    finished = done;
    while (const std::vector<int>* value = buffer.take()) {
      if (std::ranges::any_of(*value, [&](int x) { return x != value->front(); })) ++torn;
      if (value->front() <= last) ++backwards;
      last = value->front();
    }
  }
  writer.join();
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(backwards, 0);
  EXPECT_EQ(last, 50'000);
}

}  // namespace
}  // namespace waymark::daemon
