#include <gtest/gtest.h>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"
#include "realtime/kernel/rings/numbered_pool.hpp"
#include "tests/support/heap_counter.hpp"

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

TEST(FixedQueue, DropsTheOldestOnRequest) {
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

namespace {

TEST(NumberedPool, GivesEachItemItsNumberAndKeepsItUntilItIsErased) {
  NumberedPool<int> pool(3);
  EXPECT_TRUE(pool.empty());
  EXPECT_FALSE(pool.has(0));
  for (int k = 0; k < 3; ++k) EXPECT_EQ(pool.add(10 * k), k);
  EXPECT_TRUE(pool.full());
  pool.erase(1);
  EXPECT_FALSE(pool.has(1));
  EXPECT_EQ(pool.add(30), 3);
  EXPECT_EQ(pool[0], 0);
  EXPECT_EQ(pool[2], 20);
  EXPECT_EQ(pool[3], 30);
  EXPECT_EQ(pool.back(), 30);
  EXPECT_EQ(std::vector<int>(pool.numbers().begin(), pool.numbers().end()), (std::vector<int>{0, 2, 3}));
  EXPECT_EQ(pool.next(), 4);
  EXPECT_EQ(pool.position(1), 1U);
}

TEST(NumberedPool, GoesOnForEverInTheSameMemory) {
  NumberedPool<int> pool(16);
  const test::ThreadCost before = test::threadCost();
  for (int k = 0; k < 10000; ++k) {
    if (pool.full()) pool.erase(pool.numbers()[static_cast<std::size_t>(k % 15)]);
    EXPECT_EQ(pool.add(-k), k);
  }
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0U);
  for (const int number : pool.numbers()) EXPECT_EQ(pool[static_cast<std::size_t>(number)], -number);
}

TEST(NumberedPool, SavedAndLoadedItHasTheSameItemsAndRefusesNumbersThatDoNotRise) {
  NumberedPool<int> pool(4), loaded(4), smaller(2);
  for (int k = 0; k < 9; ++k) {
    if (pool.full()) pool.erase(pool.numbers()[1]);
    (void)pool.add(k * k);
  }
  std::vector<std::uint8_t> bytes(1000);
  StateWriter writer(bytes);
  writer(pool);
  StateReader reader(writer.written());
  ASSERT_TRUE(reader(loaded));
  EXPECT_EQ(loaded.next(), 9);
  for (const int number : pool.numbers()) {
    ASSERT_TRUE(loaded.has(number));
    EXPECT_EQ(loaded[static_cast<std::size_t>(number)], number * number);
  }
  StateReader again(writer.written());
  EXPECT_FALSE(again(smaller));
  bytes[12] = 200;  // the first number
  StateReader damaged(writer.written());
  EXPECT_FALSE(damaged(loaded));
}

}  // namespace
}  // namespace fathom::rt
