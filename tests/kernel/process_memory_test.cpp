#include "realtime/kernel/memory/process_memory.hpp"

#include <gtest/gtest.h>

#include "realtime/kernel/arena.hpp"
#include "realtime/kernel/shared_memory.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
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
