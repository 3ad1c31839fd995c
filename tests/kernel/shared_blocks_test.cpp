#include <gtest/gtest.h>

#include <cstring>
#include <set>
#include <system_error>
#include <thread>

#include "realtime/kernel/rings/broadcast_ring.hpp"
#include "realtime/kernel/rings/shared_blocks.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"

namespace fathom::rt {
namespace {

TEST(SharedBlocks, GivesEveryBlockOnceThenRefusesAndCounts) {
  SharedBlocks pool(3, 100);
  std::set<std::uint32_t> given;
  for (int i = 0; i < 3; ++i) given.insert(pool.acquire());
  EXPECT_EQ(given.size(), 3u);
  EXPECT_FALSE(given.contains(SharedBlocks::kNone));
  EXPECT_EQ(pool.acquire(), SharedBlocks::kNone);
  EXPECT_EQ(pool.acquire(), SharedBlocks::kNone);
  EXPECT_EQ(pool.refused(), 2u);
  EXPECT_EQ(pool.held(), 3u);
  EXPECT_EQ(pool.highWater(), 3u);
}

TEST(SharedBlocks, FreesABlockWhenItsLastHolderLetsGo) {
  SharedBlocks pool(1, 8);
  const std::uint32_t block = pool.acquire();
  pool.retain(block);
  pool.release(block);
  EXPECT_EQ(pool.acquire(), SharedBlocks::kNone);
  EXPECT_EQ(pool.held(), 1u);
  pool.release(block);
  EXPECT_EQ(pool.held(), 0u);
  EXPECT_EQ(pool.acquire(), block);
  EXPECT_EQ(pool.highWater(), 1u);
}

TEST(SharedBlocks, KeepsBlocksApartInCacheLines) {
  SharedBlocks pool(4, 65);
  for (int i = 0; i < 4; ++i) {
    const std::uint32_t block = pool.acquire();
    const auto bytes = pool.bytes(block);
    ASSERT_EQ(bytes.size(), 65u);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(bytes.data()) % 64, 0u);
    std::memset(bytes.data(), static_cast<int>(block) + 1, bytes.size());
  }
  for (std::uint32_t block = 0; block < 4; ++block)
    for (const std::byte byte : pool.bytes(block)) ASSERT_EQ(byte, std::byte(block + 1));
}

TEST(SharedBlocks, RefusesAPoolOfNothingAndOneThatNoMachineHas) {
  EXPECT_THROW(SharedBlocks(0, 8), std::system_error);
  EXPECT_THROW(SharedBlocks(8, 0), std::system_error);
  EXPECT_THROW(SharedBlocks(1000, SIZE_MAX / 8), std::system_error);
}

// A writer hands blocks to two readers, each of which holds them too; nobody may ever read a block that was
// given out again in the meantime.
TEST(SharedBlocks, NeverGivesABlockOutWhileAnotherThreadHoldsIt) {
  constexpr std::uint64_t kSent = 20'000;
  struct Frame {
    std::uint32_t block = 0;
    std::uint64_t number = 0;
  };
  SharedBlocks pool(6, 256);
  const auto rings = std::make_unique<SpscRing<Frame, 4>[]>(2);
  std::atomic<bool> done{false};
  std::atomic<std::uint64_t> torn{0}, read{0};

  const auto reader = [&](SpscRing<Frame, 4>& ring) {
    for (;;) {
      const bool last = done.load(std::memory_order_acquire);
      Frame frame;
      if (!ring.pop(frame)) {
        if (last) return;
        std::this_thread::yield();
        continue;
      }
      const auto bytes = pool.bytes(frame.block);
      std::uint64_t first = 0, end = 0;
      std::memcpy(&first, bytes.data(), sizeof first);
      std::memcpy(&end, bytes.data() + bytes.size() - sizeof end, sizeof end);
      torn += first != frame.number || end != frame.number;
      ++read;
      pool.release(frame.block);
    }
  };
  std::thread a([&] { reader(rings[0]); });
  std::thread b([&] { reader(rings[1]); });
  std::uint64_t sent = 0;
  for (std::uint64_t number = 1; sent < kSent; ++number) {
    const std::uint32_t block = pool.acquire();
    if (block == SharedBlocks::kNone) {
      std::this_thread::yield();
      continue;
    }
    const auto bytes = pool.bytes(block);
    std::memcpy(bytes.data(), &number, sizeof number);
    std::memcpy(bytes.data() + bytes.size() - sizeof number, &number, sizeof number);
    for (int i = 0; i < 2; ++i) {
      pool.retain(block);
      if (rings[i].push({block, number}))
        ++sent;
      else
        pool.release(block);
    }
    pool.release(block);
  }
  done.store(true, std::memory_order_release);
  a.join();
  b.join();
  EXPECT_EQ(torn.load(), 0u);
  EXPECT_EQ(read.load(), sent);
  EXPECT_EQ(pool.held(), 0u);
}

TEST(LatestValue, HasNothingBeforeTheFirstWrite) {
  LatestValue<int> slot;
  int value = 77;
  EXPECT_FALSE(slot.read(value));
  EXPECT_FALSE(slot.readNew(value));
  EXPECT_EQ(value, 77);
}

TEST(LatestValue, GivesOnlyTheNewestOfManyWrites) {
  LatestValue<int> slot;
  for (int i = 0; i < 10; ++i) slot.write(i);
  int value = -1;
  ASSERT_TRUE(slot.read(value));
  EXPECT_EQ(value, 9);
}

TEST(LatestValue, CanBeReadAgainButIsNewOnlyOnce) {
  LatestValue<int> slot;
  slot.write(3);
  int value = -1;
  ASSERT_TRUE(slot.readNew(value));
  EXPECT_FALSE(slot.readNew(value));
  value = -1;
  ASSERT_TRUE(slot.read(value));
  EXPECT_EQ(value, 3);
  slot.write(4);
  ASSERT_TRUE(slot.readNew(value));
  EXPECT_EQ(value, 4);
}

TEST(LatestValue, TwoThreadsNeverSeeATornOrOlderValue) {
  using Block = std::array<std::uint64_t, 32>;
  constexpr std::uint64_t kWrites = 20000;
  LatestValue<Block> slot;
  std::atomic<bool> done{false};
  std::thread writer([&] {
    for (std::uint64_t i = 1; i <= kWrites; ++i) {
      Block block;
      block.fill(i);
      slot.write(block);
    }
    done = true;
  });
  std::uint64_t torn = 0, older = 0, last = 0;
  Block block{};
  const auto check = [&] {
    if (!slot.read(block)) return;
    for (std::uint64_t word : block)
      if (word != block[0]) ++torn;
    if (block[0] < last) ++older;
    last = block[0];
  };
  while (!done) check();
  check();
  writer.join();
  EXPECT_EQ(torn, 0u);
  EXPECT_EQ(older, 0u);
  EXPECT_EQ(last, kWrites);
}

}  // namespace
}  // namespace fathom::rt
