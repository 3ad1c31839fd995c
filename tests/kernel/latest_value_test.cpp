#include "realtime/kernel/rings/latest_value.hpp"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <thread>

namespace fathom::rt {
namespace {

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
