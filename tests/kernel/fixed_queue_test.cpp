#include "realtime/kernel/fixed_queue.hpp"

#include <gtest/gtest.h>

namespace fathom::rt {
namespace {

TEST(FixedQueue, IsEmptyAtFirst) {
  const FixedQueue<int, 3> queue;
  EXPECT_TRUE(queue.empty());
  EXPECT_FALSE(queue.full());
  EXPECT_EQ(queue.size(), 0u);
}

TEST(FixedQueue, RefusesAndCountsWhenFull) {
  FixedQueue<int, 3> queue;
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(queue.push(i));
  EXPECT_FALSE(queue.push(3));
  EXPECT_EQ(queue.refused(), 1u);
  EXPECT_EQ(queue.back(), 2);
  EXPECT_EQ(queue.highWater(), 3u);
}

TEST(FixedQueue, DropsTheOldestWhenTold) {
  FixedQueue<int, 3> queue;
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(queue.pushDroppingOldest(i));
  EXPECT_TRUE(queue.pushDroppingOldest(3));
  EXPECT_EQ(queue.front(), 1);
  EXPECT_EQ(queue.back(), 3);
}

TEST(FixedQueue, KeepsItsOrderWhileWrapping) {
  FixedQueue<int, 3> queue;
  for (int i = 0; i < 50; ++i) {
    queue.pushDroppingOldest(i);
    for (std::size_t k = 0; k < queue.size(); ++k)
      EXPECT_EQ(queue[k], i - static_cast<int>(queue.size() - 1 - k));
  }
}

TEST(FixedQueue, ErasesFromTheMiddleAcrossTheWrap) {
  FixedQueue<int, 4> queue;
  for (int i = 0; i < 6; ++i) queue.pushDroppingOldest(i);
  queue.erase(1);
  ASSERT_EQ(queue.size(), 3u);
  EXPECT_EQ(queue[0], 2);
  EXPECT_EQ(queue[1], 4);
  EXPECT_EQ(queue[2], 5);
  EXPECT_TRUE(queue.push(6));
  EXPECT_EQ(queue.back(), 6);
}

}  // namespace
}  // namespace fathom::rt
