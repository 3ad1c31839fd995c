#include <gtest/gtest.h>

#include <string>

#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/arena.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/memory/process_memory.hpp"
#include "realtime/kernel/memory/shared_memory.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

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

}  // namespace

namespace {

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
