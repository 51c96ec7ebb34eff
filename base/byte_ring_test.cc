#include "base/byte_ring.h"

#include <cstdint>
#include <random>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace waymark {
namespace {

bool put(ByteRing& ring, std::size_t size, std::uint8_t value) {
  const std::span<std::uint8_t> room = ring.reserve(size);
  if (room.empty()) return false;
  std::ranges::fill(room, value);
  ring.commit();
  return true;
}

TEST(ByteRing, GivesBackWhatWasPutIn) {
  ByteRing ring(1000);
  EXPECT_TRUE(ring.front().empty());
  ASSERT_TRUE(put(ring, 3, 7));
  ASSERT_TRUE(put(ring, 100, 8));
  EXPECT_EQ(ring.front().size(), 3u);
  EXPECT_EQ(ring.front()[2], 7);
  ring.pop();
  EXPECT_EQ(ring.front().size(), 100u);
  ring.pop();
  EXPECT_TRUE(ring.front().empty());
}

TEST(ByteRing, RejectsWhatDoesNotFit) {
  ByteRing ring(100);
  EXPECT_FALSE(put(ring, 0, 1));
  EXPECT_FALSE(put(ring, 200, 1));
  ASSERT_TRUE(put(ring, 60, 1));
  EXPECT_FALSE(put(ring, 60, 2));
  ring.pop();
  EXPECT_TRUE(put(ring, 60, 3)) << "the end is passed over";
  EXPECT_EQ(ring.front()[0], 3);
}

TEST(ByteRing, AReservationThatIsNotCommittedIsNoPiece) {
  ByteRing ring(1000);
  ASSERT_EQ(ring.reserve(10).size(), 10u);
  EXPECT_TRUE(ring.front().empty());
  ASSERT_TRUE(put(ring, 20, 4));
  EXPECT_EQ(ring.front().size(), 20u);
}

// Two threads, pieces of any size: all of them arrive, in order and as they were.
TEST(ByteRing, BetweenThreads) {
  constexpr int kPieces = 5000;
  ByteRing ring(4096);
  std::thread producer([&ring] {
    std::mt19937 random(1);
    for (int i = 0; i < kPieces;) {
      std::mt19937 before = random;
      if (put(ring, 1 + random() % 900, static_cast<std::uint8_t>(i))) {
        ++i;
      } else {
        random = before;
        std::this_thread::yield();
      }
    }
  });
  std::mt19937 random(1);
  int wrong = 0;
  for (int i = 0; i < kPieces;) {
    const std::span<const std::uint8_t> piece = ring.front();
    if (piece.empty()) {
      std::this_thread::yield();
      continue;
    }
    wrong += piece.size() == 1 + random() % 900 ? 0 : 1;
    for (const std::uint8_t byte : piece) wrong += byte == static_cast<std::uint8_t>(i) ? 0 : 1;
    ring.pop();
    ++i;
  }
  producer.join();
  EXPECT_EQ(wrong, 0);
}

}  // namespace
}  // namespace waymark
