#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <system_error>
#include <thread>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/kernel/rings/broadcast_ring.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"
#include "realtime/kernel/rings/numbered_pool.hpp"
#include "realtime/kernel/rings/shared_blocks.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

// Whole only if all its numbers are the same.
struct Wide {
  std::array<std::uint64_t, 9> same{};
  static Wide of(std::uint64_t n) {
    Wide wide;
    wide.same.fill(n);
    return wide;
  }
  [[nodiscard]] bool whole() const {
    for (const std::uint64_t n : same)
      if (n != same[0]) return false;
    return true;
  }
};
using Ring = BroadcastRing<Wide, 8>;

TEST(BroadcastRing, GivesEachPositionToEveryReaderThatAsks) {
  Ring ring;
  Wide value = Wide::of(77);
  EXPECT_EQ(ring.read(0, value), Ring::Read::kNotYet);
  EXPECT_EQ(value.same[0], 77U) << "untouched";
  for (std::uint64_t n = 0; n < 8; ++n) ring.push(Wide::of(100 + n));
  for (int reader = 0; reader < 2; ++reader)
    for (std::uint64_t n = 0; n < 8; ++n) {
      ASSERT_EQ(ring.read(n, value), Ring::Read::kGot);
      EXPECT_EQ(value.same[0], 100 + n);
    }
  EXPECT_EQ(ring.read(8, value), Ring::Read::kNotYet);
}

TEST(BroadcastRing, SaysWhatIsOverwrittenAndWhatWasBeforeItsBeginning) {
  Ring ring;
  ring.start(1000);
  Wide value;
  EXPECT_EQ(ring.read(999, value), Ring::Read::kOverrun);
  EXPECT_EQ(ring.read(1000, value), Ring::Read::kNotYet);
  for (std::uint64_t n = 0; n < 9; ++n) ring.push(Wide::of(n));
  EXPECT_EQ(ring.next(), 1009U);
  EXPECT_EQ(ring.read(1000, value), Ring::Read::kOverrun);
  ASSERT_EQ(ring.read(1001, value), Ring::Read::kGot);
  EXPECT_EQ(value.same[0], 1U);
}

TEST(BroadcastRing, NeverGivesATornEntryToAReaderThatIsLapped) {
  Ring ring;
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    for (std::uint64_t n = 0; !stop; ++n) ring.push(Wide::of(n));
  });
  std::uint64_t got = 0, overrun = 0;
  for (std::uint64_t position = 0; got < 2000 || overrun == 0;) {
    Wide value;
    switch (ring.read(position, value)) {
      case Ring::Read::kGot:
        ASSERT_TRUE(value.whole());
        ASSERT_EQ(value.same[0], position);
        ++got;
        ++position;
        break;
      case Ring::Read::kNotYet:
        break;
      case Ring::Read::kOverrun:
        ++overrun;
        position = ring.next() - 1;
        break;
    }
  }
  stop = true;
  writer.join();
}

TEST(SharedRecord, GivesTheNewestWholeValueAndNoneBeforeTheFirst) {
  SharedRecord<Wide> record;
  Wide value = Wide::of(7);
  EXPECT_FALSE(record.read(value));
  EXPECT_EQ(value.same[0], 7U);
  record.write(Wide::of(1));
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    for (std::uint64_t n = 1; !stop; ++n) record.write(Wide::of(n));
  });
  std::uint64_t last = 0;
  for (int k = 0; k < 2000; ++k) {
    if (!record.read(value)) continue;
    ASSERT_TRUE(value.whole());
    ASSERT_GE(value.same[0], last);
    last = value.same[0];
  }
  stop = true;
  writer.join();
}

TEST(SharedMemory, AnotherMappingSeesWhatIsWrittenAndCannotWriteWhereItMayOnlyRead) {
  SharedMemory mine(5000);
  EXPECT_GE(mine.bytes(), 5000U);
  mine.data()[4999] = std::byte{42};
  const SharedMemory other(::dup(mine.file()), 5000, false);
  EXPECT_EQ(other.data()[4999], std::byte{42});
  EXPECT_DEATH(other.data()[0] = std::byte{1}, "");
}

TEST(SharedMemory, RefusesNothingMoreThanThereIsAndAFileThatIsTooShort) {
  EXPECT_THROW(SharedMemory(0), std::system_error);
  const SharedMemory mine(100);
  EXPECT_THROW(SharedMemory(::dup(mine.file()), mine.bytes() + 1, true), std::system_error);
}

// As the mapper and the vehicle process are.
TEST(SharedMemory, ARingInItCrossesToAnotherProcessThatIsKilledInTheMiddle) {
  SharedMemory memory(sizeof(SharedRecord<Wide>));
  auto* record = new (memory.data()) SharedRecord<Wide>;
  const pid_t child = ::fork();
  if (child == 0)
    for (std::uint64_t n = 1;; ++n) record->write(Wide::of(n));
  Wide value;
  while (!record->read(value)) continue;
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  if (record->read(value)) {
    EXPECT_TRUE(value.whole());
  }
  record->write(Wide::of(5));
  ASSERT_TRUE(record->read(value)) << "the next writer continues";
  EXPECT_EQ(value.same[0], 5U);
}

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
