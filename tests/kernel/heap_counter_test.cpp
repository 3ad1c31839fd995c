#include "tests/support/heap_counter.hpp"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

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
