#include "realtime/kernel/memory/arena.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <system_error>

#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

const std::size_t kPage = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));

TEST(Arena, IsEmptyAndWholePagesLargeAtFirst) {
  const Arena arena(1);
  EXPECT_EQ(arena.capacity(), kPage);
  EXPECT_EQ(arena.used(), 0u);
}

TEST(Arena, KeepsTheAlignmentAskedFor) {
  Arena arena(1 << 16);
  for (std::size_t alignment : {1, 2, 16, 64, 4096, 16384}) {
    ASSERT_NE(arena.allocate(1, 1), nullptr);
    void* memory = arena.allocate(8, alignment);
    ASSERT_NE(memory, nullptr);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(memory) % alignment, 0u) << alignment;
  }
}

TEST(Arena, GivesExactlyItsCapacityThenRefusesAndCounts) {
  Arena arena(2 * kPage);
  ASSERT_NE(arena.allocate(kPage, 1), nullptr);
  ASSERT_NE(arena.allocate(kPage, 1), nullptr);
  EXPECT_EQ(arena.allocate(1, 1), nullptr);
  EXPECT_EQ(arena.refused(), 1u);
  EXPECT_EQ(arena.used(), 2 * kPage);
}

TEST(Arena, RefusesASizeThatWouldOverflow) {
  Arena arena(kPage);
  EXPECT_EQ(arena.allocate(SIZE_MAX - 8), nullptr);
  EXPECT_TRUE(arena.allocateArray<double>(SIZE_MAX / 4).empty());
  EXPECT_EQ(arena.refused(), 2u);
  EXPECT_EQ(arena.used(), 0u);
}

TEST(Arena, UsingItCausesNoPageFaultAndNoHeapCall) {
  Arena arena(256 * kPage);
  const test::ThreadCost before = test::threadCost();
  void* memory = arena.allocate(256 * kPage, 1);
  std::memset(memory, 1, 256 * kPage);
  const test::ThreadCost cost = test::threadCost() - before;
  EXPECT_EQ(cost.heap_calls, 0u);
  if (!test::sanitized()) {
    EXPECT_EQ(cost.minor_faults + cost.major_faults, 0u);
  }
}

TEST(Arena, LocksItsMemoryOrSaysWhatIsMissing) {
  try {
    const Arena arena(4 * kPage, MemoryLock::kLocked);
    EXPECT_EQ(arena.capacity(), 4 * kPage);
  } catch (const std::system_error& e) {
    EXPECT_NE(std::string(e.what()).find("RLIMIT_MEMLOCK"), std::string::npos);
  }
}

TEST(Arena, AnImpossibleSizeFailsAtConstruction) {
  EXPECT_THROW(Arena(0), std::system_error);
  EXPECT_THROW(Arena(SIZE_MAX), std::system_error);
}

}  // namespace
}  // namespace fathom::rt
