#include "daemon/frames/newest_wins_queue.h"

#include <chrono>
#include <set>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "capture/frame.h"

namespace waymark::daemon {
namespace {

using capture::FramePool;
using capture::FramePtr;
using FrameQueue = NewestWinsQueue<FramePtr>;

FramePtr numbered(FramePool& pool, std::uint64_t sequence) {
  FramePtr frame = pool.acquire();
  if (frame) {
    frame->setStamp({.sequence = sequence});
    frame->pixels()[0] = static_cast<std::uint8_t>(sequence);
  }
  return frame;
}

TEST(NewestWinsQueue, GivesItemsInOrder) {
  FramePool pool(1, 1, 4);
  FrameQueue queue(4);
  for (std::uint64_t i = 0; i < 4; ++i) queue.push(numbered(pool, i));
  for (std::uint64_t i = 0; i < 4; ++i) EXPECT_EQ(queue.pop()->stamp().sequence, i);
  EXPECT_EQ(queue.dropped(), 0u);
  EXPECT_EQ(queue.pushed(), 4u);
}

TEST(NewestWinsQueue, DropsTheOldestWhenFullAndGivesItBack) {
  FramePool pool(1, 1, 3);
  FrameQueue queue(2);
  // Five frames through three buffers: only possible when the dropped ones return to the pool.
  for (std::uint64_t i = 0; i < 5; ++i) {
    FramePtr frame = numbered(pool, i);
    ASSERT_TRUE(frame) << "frame " << i;
    queue.push(std::move(frame));
  }
  EXPECT_EQ(queue.dropped(), 3u);
  EXPECT_EQ(queue.pop()->stamp().sequence, 3u);
  EXPECT_EQ(queue.pop()->stamp().sequence, 4u);
}

TEST(NewestWinsQueue, ANudgeWakesAConsumerThatWaits) {
  FramePool pool(1, 1, 2);
  FrameQueue queue(2);
  std::thread waker([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    queue.wake();
  });
  EXPECT_EQ(queue.pop(), nullptr);
  EXPECT_FALSE(queue.finished());
  waker.join();
  queue.wake();
  queue.push(numbered(pool, 1));
  EXPECT_EQ(queue.pop()->stamp().sequence, 1U) << "frames come first";
  queue.close();
  EXPECT_TRUE(queue.finished());
}

TEST(NewestWinsQueue, GivesTheRestAfterCloseThenNull) {
  FramePool pool(1, 1, 2);
  FrameQueue queue(2);
  queue.push(numbered(pool, 7));
  queue.close();
  EXPECT_EQ(queue.pop()->stamp().sequence, 7u);
  EXPECT_EQ(queue.pop(), nullptr);
  EXPECT_EQ(queue.pop(), nullptr);
}

TEST(NewestWinsQueue, WhoIsBehindAtTheEndGetsTheNewest) {
  FramePool pool(1, 1, 4);
  FrameQueue queue(4);
  for (std::uint64_t i = 0; i < 4; ++i) queue.push(numbered(pool, i));
  EXPECT_EQ(queue.pop()->stamp().sequence, 0U);
  queue.closeWithNewest();
  EXPECT_EQ(queue.pop()->stamp().sequence, 3U);
  EXPECT_TRUE(queue.finished());
  EXPECT_EQ(queue.pop(), nullptr);
  EXPECT_EQ(queue.dropped(), 2U);
  std::vector<FramePtr> all(4);
  for (FramePtr& frame : all) frame = pool.acquire();
  EXPECT_TRUE(all[0] && all[1] && all[2] && all[3]) << "their owner has them back";
}

TEST(NewestWinsQueue, WhoKeepsUpLosesNothingAtTheEnd) {
  FramePool pool(1, 1, 2);
  FrameQueue queue(2);
  queue.push(numbered(pool, 5));
  queue.closeWithNewest();
  EXPECT_EQ(queue.pop()->stamp().sequence, 5U);
  EXPECT_TRUE(queue.finished());
  EXPECT_EQ(queue.dropped(), 0U);
  FrameQueue empty(2);
  empty.closeWithNewest();
  EXPECT_EQ(empty.pop(), nullptr);
}

TEST(NewestWinsQueue, CloseWakesAWaitingConsumer) {
  FrameQueue queue(2);
  std::thread consumer([&] { EXPECT_EQ(queue.pop(), nullptr); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  queue.close();
  consumer.join();
}

TEST(NewestWinsQueue, IsIdleOnlyWhenNothingIsOut) {
  FramePool pool(1, 1, 2);
  FrameQueue queue(2);
  EXPECT_TRUE(queue.idle());
  queue.push(numbered(pool, 0));
  EXPECT_FALSE(queue.idle()) << "one waits";
  FramePtr held = queue.pop();
  EXPECT_FALSE(queue.idle()) << "the consumer holds one";
  held.reset();
  queue.close();
  EXPECT_EQ(queue.pop(), nullptr);
  EXPECT_TRUE(queue.idle());
}

TEST(NewestWinsQueue, ReturnsWhatWaitsWhenDestroyed) {
  FramePool pool(1, 1, 2);
  {
    FrameQueue queue(2);
    queue.push(numbered(pool, 0));
    queue.push(numbered(pool, 1));
    EXPECT_EQ(pool.acquire(), nullptr);
  }
  const FramePtr a = pool.acquire();
  const FramePtr b = pool.acquire();
  EXPECT_TRUE(a && b);
}

// Two threads as fast as they can, with hiccups on the consumer's side, for every small capacity:
// nothing lost without being counted, nothing twice, nothing out of order, no buffer torn.
class NewestWinsQueueStress : public testing::TestWithParam<std::size_t> {};

TEST_P(NewestWinsQueueStress, KeepsOrderAndCountsEveryLoss) {
  constexpr std::uint64_t kFrames = 200'000;
  FramePool pool(1, 1, static_cast<int>(GetParam()) + 2);
  FrameQueue queue(GetParam());
  std::uint64_t no_buffer = 0;

  std::thread producer([&] {
    for (std::uint64_t i = 1; i <= kFrames; ++i) {
      FramePtr frame = numbered(pool, i);
      if (!frame) {
        ++no_buffer;
        continue;
      }
      queue.push(std::move(frame));
    }
    queue.closeWithNewest();
  });

  std::uint64_t received = 0;
  std::uint64_t last = 0;
  std::uint64_t disorder = 0;
  std::uint64_t torn = 0;
  while (const FramePtr frame = queue.pop()) {
    ++received;
    const std::uint64_t sequence = frame->stamp().sequence;
    if (sequence <= last) ++disorder;
    if (frame->pixels()[0] != static_cast<std::uint8_t>(sequence)) ++torn;
    last = sequence;
    if (received % 1000 == 0) std::this_thread::sleep_for(std::chrono::microseconds(50));
  }
  producer.join();

  EXPECT_EQ(disorder, 0u);
  EXPECT_EQ(torn, 0u);
  // One for the producer, one for the consumer, the rest in the queue: buffers never run out.
  EXPECT_EQ(no_buffer, 0u);
  EXPECT_EQ(received + queue.dropped(), kFrames);
  EXPECT_EQ(last, kFrames) << "the newest frame always gets through";
  EXPECT_TRUE(queue.idle());
}

INSTANTIATE_TEST_SUITE_P(Capacities, NewestWinsQueueStress, testing::Values(1, 2, 3, 4, 7));

}  // namespace
}  // namespace waymark::daemon
