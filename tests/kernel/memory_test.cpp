#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <system_error>
#include <thread>

#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/arena.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/rings/shared_blocks.hpp"
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

TEST(MemoryBudget, SumsThePlansAndSaysWhetherTheyFit) {
  MemoryBudget budget(10 * kMebibyte);
  EXPECT_TRUE(budget.fits());
  budget.add("tiles", 6 * kMebibyte);
  budget.addFixed("stacks", 4 * kMebibyte);
  EXPECT_EQ(budget.plannedBytes(), 10 * kMebibyte);
  EXPECT_TRUE(budget.fits());
  budget.add("slots", 1);
  EXPECT_FALSE(budget.fits());
}

TEST(MemoryBudget, ReadsAGaugeACallbackAndAFixedPool) {
  MemoryBudget budget(10 * kMebibyte);
  PoolGauge& tiles = budget.add("tiles", 100);
  budget.add("ring", 50, [] { return PoolUse{20, 30, 2}; });
  budget.addFixed("stacks", 40);
  EXPECT_FALSE(budget.read(0).measured);
  tiles.set(70);
  tiles.set(60, 3);
  const MemoryBudget::Row row = budget.read(0);
  EXPECT_TRUE(row.measured);
  EXPECT_EQ(row.use.used, 60u);
  EXPECT_EQ(row.use.high_water, 70u);
  EXPECT_EQ(row.use.refused, 3u);
  EXPECT_EQ(budget.read(1).use.high_water, 30u);
  EXPECT_EQ(budget.read(2).use.used, 40u);
}

TEST(MemoryBudget, AGaugeStaysWhereItIsWhilePoolsAreAdded) {
  MemoryBudget budget(kMebibyte);
  PoolGauge& first = budget.add("first", 1);
  for (int i = 0; i < 100; ++i) budget.add("more", 1);
  first.set(1);
  EXPECT_EQ(budget.read(0).use.used, 1u);
}

TEST(MemoryBudget, PrintsTheLargestPoolFirstAndTheTotal) {
  MemoryBudget budget(768 * kMebibyte);
  budget.add("small", 1 * kMebibyte);
  PoolGauge& large = budget.add("large", 600 * kMebibyte);
  large.set(300 * kMebibyte, 7);
  const std::string plan = budget.table(false), measured = budget.table(true);
  EXPECT_LT(plan.find("large"), plan.find("small"));
  EXPECT_NE(plan.find("601.00 of 768.00 MiB, fits"), std::string::npos) << plan;
  EXPECT_EQ(plan.find("300.00"), std::string::npos);
  EXPECT_NE(measured.find("300.00"), std::string::npos) << measured;
}

TEST(MemoryBudget, ReadingTakesNoHeap) {
  MemoryBudget budget(kMebibyte);
  budget.add("tiles", 100).set(3);
  budget.add("ring", 50, [] { return PoolUse{1, 1, 0}; });
  const test::ThreadCost before = test::threadCost();
  std::size_t used = 0;
  for (std::size_t i = 0; i < budget.pools(); ++i) used += budget.read(i).use.used;
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_EQ(used, 4u);
}

TEST(ProcessMemory, SeesMemoryThatIsTaken) {
  constexpr std::size_t kBytes = std::size_t{32} << 20;
  ProcessMemory memory;
  ProcessFigures before, after;
  ASSERT_TRUE(memory.read(before));
  const std::size_t exact_before = exactResidentBytes();
  const Arena arena(kBytes);
  ASSERT_TRUE(memory.read(after));
  EXPECT_GE(after.resident, before.resident + kBytes / 2);
  EXPECT_GE(after.resident_private, before.resident_private + kBytes / 2);
  EXPECT_GE(exactResidentBytes(), exact_before + kBytes);
  EXPECT_GE(after.minor_faults + after.major_faults, before.minor_faults + before.major_faults);
  EXPECT_GT(after.resident_files, 0u);
  EXPECT_GE(after.highest_resident, kBytes);
}

TEST(ProcessMemory, MemoryThatProcessesShareIsNoFile) {
  constexpr std::size_t kBytes = std::size_t{32} << 20;
  const std::size_t before = mappedFileBytes();
  EXPECT_GT(privateFileBytes(), 0u);
  EXPECT_LT(privateFileBytes(), before);
  const SharedMemory shared(kBytes);
  EXPECT_EQ(mappedFileBytes(), before);
}

TEST(ProcessMemory, ReadsWithoutHeap) {
  ProcessMemory memory;
  ProcessFigures figures;
  const test::ThreadCost before = test::threadCost();
  ASSERT_TRUE(memory.read(figures));
  EXPECT_GT(exactResidentBytes(), 0u);
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
}

}  // namespace
}  // namespace fathom::rt

namespace fathom::test {
namespace {

// Keeps the compiler from leaving a pair of new and delete out.
void use(const void* memory) {
  asm volatile("" : : "g"(memory) : "memory");
}

TEST(HeapCounter, CountsNothingWhenNothingIsAllocated) {
  const ThreadCost before = threadCost();
  int value = 3;
  use(&value);
  EXPECT_EQ((threadCost() - before).heap_calls, 0u);
}

TEST(HeapCounter, CountsNewAndDelete) {
  const ThreadCost before = threadCost();
  {
    const auto owned = std::make_unique<int>(1);
    use(owned.get());
  }
  EXPECT_EQ((threadCost() - before).heap_calls, 2u);
}

TEST(HeapCounter, CountsTheCFamilyAndTheAlignedForms) {
  const ThreadCost before = threadCost();
  void* a = std::malloc(10);
  use(a);
  void* b = std::calloc(3, 10);
  use(b);
  void* c = nullptr;
  ASSERT_EQ(::posix_memalign(&c, 64, 100), 0);
  use(c);
  void* d = std::aligned_alloc(64, 128);
  use(d);
  const std::uint64_t allocations = (threadCost() - before).heap_calls;
  std::free(a);
  std::free(b);
  std::free(c);
  std::free(d);
  const std::uint64_t all = (threadCost() - before).heap_calls;
  // ThreadSanitizer's hook leaves out the allocations, not the frees, of the aligned forms.
  EXPECT_GE(allocations, sanitized() ? 2u : 4u);
  EXPECT_EQ(all - allocations, 4u);
}

TEST(HeapCounter, CountsAllocationsInsideSharedLibraries) {
  const ThreadCost before = threadCost();
  const std::string text(1000, 'x');  // std::string's growth is compiled into libstdc++
  use(text.data());
  EXPECT_GE((threadCost() - before).heap_calls, 1u);
}

TEST(HeapCounter, CountsEachThreadByItself) {
  std::uint64_t inside = 0;
  std::thread other([&] {
    const ThreadCost before = threadCost();
    for (int i = 0; i < 50; ++i) use(std::make_unique<int>(i).get());
    inside = (threadCost() - before).heap_calls;
  });
  const ThreadCost before = threadCost();
  other.join();
  // Joining may free the other's state, but the other's fifty pairs are its own.
  EXPECT_LT((threadCost() - before).heap_calls, 10u);
  EXPECT_EQ(inside, 100u);
}

TEST(HeapCounter, CountsThePageFaultsOfFreshMemory) {
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  constexpr std::size_t kPages = 64;
  void* memory = ::mmap(nullptr, kPages * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  ::madvise(memory, kPages * page, MADV_NOHUGEPAGE);
  const ThreadCost before = threadCost();
  for (std::size_t i = 0; i < kPages; ++i) *(static_cast<volatile char*>(memory) + i * page) = 1;
  const ThreadCost cost = threadCost() - before;
  ::munmap(memory, kPages * page);
  EXPECT_GE(cost.minor_faults + cost.major_faults, kPages);
}

}  // namespace
}  // namespace fathom::test
