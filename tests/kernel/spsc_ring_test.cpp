#include "realtime/kernel/rings/spsc_ring.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <thread>

namespace fathom::rt {
namespace {

TEST(SpscRing, IsEmptyAtFirstAndLeavesTheOutputAlone) {
  SpscRing<int, 4> ring;
  int value = 77;
  EXPECT_FALSE(ring.pop(value));
  EXPECT_EQ(value, 77);
  EXPECT_EQ(ring.used(), 0u);
  EXPECT_EQ(ring.free(), 4u);
}

TEST(SpscRing, GivesBackOneElement) {
  SpscRing<int, 1> ring;
  ASSERT_TRUE(ring.push(5));
  int value = 0;
  ASSERT_TRUE(ring.pop(value));
  EXPECT_EQ(value, 5);
  EXPECT_FALSE(ring.pop(value));
}

TEST(SpscRing, RefusesAndCountsTheNewestWhenFull) {
  SpscRing<int, 4> ring;
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(ring.push(i));
  EXPECT_FALSE(ring.push(4));
  EXPECT_FALSE(ring.push(5));
  EXPECT_EQ(ring.refused(), 2u);
  EXPECT_EQ(ring.free(), 0u);
  int value = -1;
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(ring.pop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(ring.pop(value));
}

TEST(SpscRing, KeepsTheOrderWhileWrappingManyTimes) {
  SpscRing<int, 8> ring;
  int next_in = 0, next_out = 0;
  for (int round = 0; round < 100; ++round) {
    for (int i = 0; i < 1 + round % 8; ++i) ASSERT_TRUE(ring.push(next_in++));
    int value = -1;
    while (ring.pop(value)) EXPECT_EQ(value, next_out++);
  }
  EXPECT_EQ(next_in, next_out);
  EXPECT_EQ(ring.highWater(), 8u);
}

// Each element checks itself, so that a torn or repeated one shows.
struct Stamped {
  std::uint64_t number = 0;
  std::uint64_t negated = ~std::uint64_t{0};
};

TEST(SpscRing, TwoThreadsSeeEveryAcceptedElementOnceInOrder) {
  constexpr std::uint64_t kElements = 20000;
  SpscRing<Stamped, 16> ring;
  std::thread producer([&] {
    for (std::uint64_t i = 0; i < kElements;) {
      if (ring.push({i, ~i}))
        ++i;
      else
        std::this_thread::yield();
    }
  });
  std::uint64_t wrong = 0;
  for (std::uint64_t expected = 0; expected < kElements;) {
    Stamped value;
    if (!ring.pop(value)) {
      std::this_thread::yield();
      continue;
    }
    if (value.number != expected || value.negated != ~expected) ++wrong;
    ++expected;
  }
  producer.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(ring.used(), 0u);
  EXPECT_LE(ring.highWater(), ring.capacity());
}

}  // namespace
}  // namespace fathom::rt
