#include "realtime/kernel/memory/heap_reserve.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cstdlib>
#include <cstring>
#include <random>
#include <thread>
#include <vector>

#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/process_memory.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

// Allocates as vision does: images of some MiB and many small things, at most `live` bytes at once, each
// written whole.
void work(std::uint64_t seed, std::size_t live, int rounds) {
  std::mt19937_64 random(seed);
  std::vector<std::pair<void*, std::size_t>> held;
  held.reserve(4096);
  std::size_t total = 0;
  for (int i = 0; i < rounds; ++i) {
    const std::size_t bytes = i % 10 == 0 ? kMebibyte + random() % (2 * kMebibyte) : 16 + random() % 4000;
    while (!held.empty() && (total + bytes > live || held.size() == held.capacity())) {
      const std::size_t which = random() % held.size();
      std::free(held[which].first);
      total -= held[which].second;
      held[which] = held.back();
      held.pop_back();
    }
    void* memory = std::malloc(bytes);
    ASSERT_NE(memory, nullptr);
    std::memset(memory, 1, bytes);
    held.emplace_back(memory, bytes);
    total += bytes;
  }
  for (const auto& [memory, bytes] : held) std::free(memory);
}

class HeapReserveTest : public testing::Test {
 protected:
  void SetUp() override {
    if (test::sanitized()) GTEST_SKIP() << "a sanitizer has an allocator of its own";
    ASSERT_TRUE(HeapReserve::takeOverAllocator());
  }
};

TEST_F(HeapReserveTest, WorkThatFitsNeitherGrowsTheResidentSetNorFaults) {
  work(1, 12 * kMebibyte, 200);  // the test's own first use
  std::thread(work, 2, 12 * kMebibyte, 200).join();
  HeapReserve heap;
  ASSERT_TRUE(heap.reserve(64 * kMebibyte));
  const std::size_t before = exactResidentBytes();
  rusage faults_before{}, faults_after{};
  ::getrusage(RUSAGE_SELF, &faults_before);
  for (std::uint64_t round = 0; round < 20; ++round) work(round, 24 * kMebibyte, 500);
  ::getrusage(RUSAGE_SELF, &faults_after);
  EXPECT_EQ(heap.overflowBytes(), 0u);
  EXPECT_EQ(exactResidentBytes(), before);
  EXPECT_EQ(faults_after.ru_minflt - faults_before.ru_minflt, 0);
}

TEST_F(HeapReserveTest, AllThreadsShareTheReserve) {
  work(1, 4 * kMebibyte, 100);
  HeapReserve heap;
  ASSERT_TRUE(heap.reserve(64 * kMebibyte));
  {
    std::thread a(work, 3, 12 * kMebibyte, 1000), b(work, 4, 12 * kMebibyte, 1000);
    a.join();
    b.join();
  }
  EXPECT_EQ(heap.overflowBytes(), 0u);
}

TEST_F(HeapReserveTest, WhatDoesNotFitIsGivenAndSeen) {
  HeapReserve heap;
  ASSERT_TRUE(heap.reserve(8 * kMebibyte));
  EXPECT_EQ(heap.overflowBytes(), 0u);
  // Larger than everything that earlier tests have left in the heap.
  const std::size_t bytes = HeapReserve::heapBytes() + kMebibyte;
  void* memory = std::malloc(bytes);
  ASSERT_NE(memory, nullptr);
  EXPECT_GE(heap.usedOfReserve(), bytes);
  EXPECT_GT(heap.overflowBytes(), 0u);
  std::free(memory);
  EXPECT_GT(heap.overflowBytes(), 0u);  // never given back
}

TEST(PopulateMappings, MakesProgramTextResident) {
  if (test::sanitized()) GTEST_SKIP() << "a sanitizer maps terabytes";
  populateMappings();
  ProcessMemory memory;
  ProcessFigures figures;
  ASSERT_TRUE(memory.read(figures));
  EXPECT_GE(static_cast<double>(figures.resident_files), 0.5 * static_cast<double>(mappedFileBytes()));
}

}  // namespace
}  // namespace fathom::rt
