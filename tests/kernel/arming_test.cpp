#include <gmock/gmock.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <random>
#include <thread>

#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/threads/arming.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

using testing::HasSubstr;

// What `body` says in a process of its own that has lost every privilege, so that nothing stays behind.
std::string asNobody(const std::function<std::string()>& body) {
  std::array<int, 2> pipe{};
  EXPECT_EQ(::pipe(pipe.data()), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(pipe[0]);
    const rlimit none{0, 0}, little{64 * 1024, 64 * 1024};
    ::setrlimit(RLIMIT_RTPRIO, &none);
    ::setrlimit(RLIMIT_MEMLOCK, &little);
    constexpr uid_t kNobody = 65534;
    const bool dropped = ::geteuid() != 0 || ::setuid(kNobody) == 0;
    const std::string text = dropped ? body() : "could not drop privileges";
    const ssize_t written = ::write(pipe[1], text.data(), text.size());
    ::_exit(written == static_cast<ssize_t>(text.size()) ? 0 : 1);
  }
  ::close(pipe[1]);
  std::string text;
  std::array<char, 512> buffer{};
  for (ssize_t got; (got = ::read(pipe[0], buffer.data(), buffer.size())) > 0;)
    text.append(buffer.data(), static_cast<std::size_t>(got));
  ::close(pipe[0]);
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
  return text;
}

class Arming : public testing::Test {
 protected:
  void SetUp() override {
    if (test::sanitized()) GTEST_SKIP() << "sanitizers refuse mlockall and fork badly";
  }
  void TearDown() override { ::munlockall(); }
  MemoryBudget budget_{256 * kMebibyte};
  RealtimeConfig config_;
  HeapReserve heap_;
};

TEST_F(Arming, WithoutPrivilegesFailsAndSaysWhatTheUnitMustGrant) {
  budget_.add("pools", kMebibyte);
  const std::string message = asNobody([&] { return arm(config_, budget_, heap_, kMebibyte).message(); });
  EXPECT_THAT(message, HasSubstr("not armed"));
  EXPECT_THAT(message, HasSubstr("SCHED_FIFO: priority 80 refused"));
  EXPECT_THAT(message, HasSubstr("LimitRTPRIO=80"));
  EXPECT_THAT(message, HasSubstr("locked memory: RLIMIT_MEMLOCK is 65536"));
  EXPECT_THAT(message, HasSubstr("LimitMEMLOCK=infinity"));
  EXPECT_THAT(message, HasSubstr("--soft"));
}

TEST_F(Arming, SoftModeContinuesWithoutAndReportsIt) {
  config_.soft = true;
  const std::string message = asNobody([&] {
    const ArmingResult result = arm(config_, budget_, heap_, kMebibyte);
    return (result.armed() ? "armed|" : "refused|") + result.missingNames() + "|" + result.message();
  });
  EXPECT_THAT(message, HasSubstr("armed|SCHED_FIFO, locked memory|armed in soft mode, without real time:"));
}

TEST_F(Arming, APlanBeyondTheBudgetIsRefused) {
  budget_.add("tiles", 300 * kMebibyte);
  const ArmingResult result = checkArming(config_, budget_);
  EXPECT_FALSE(result.armed());
  EXPECT_THAT(result.missingNames(), HasSubstr("memory budget"));
  EXPECT_THAT(result.message(), HasSubstr("the pools need 300.0 MiB, [memory] budget_mib allows 256.0 MiB"));
}

TEST_F(Arming, AMachineWithoutEnoughMemoryIsRefused) {
  MemoryBudget huge(std::size_t{1} << 50);
  huge.add("tiles", std::size_t{1} << 49);
  EXPECT_THAT(checkArming(config_, huge).missingNames(), HasSubstr("memory of the machine"));
}

TEST_F(Arming, ACpuThatIsNotThereIsRefused) {
  config_.hard_cpus = {1023};
  EXPECT_THAT(checkArming(config_, budget_).message(), HasSubstr("CPU 1023 of [realtime]"));
}

TEST_F(Arming, NotesWhatTheKernelIsWithoutFailingForIt) {
  const std::string table = checkArming(config_, budget_).table();
  EXPECT_THAT(table, HasSubstr("note     kernel"));
  EXPECT_THAT(table, HasSubstr("SCHED_FIFO"));
}

TEST_F(Arming, WhereAllIsGrantedMemoryIsLockedAndNewMemoryComesWithoutFaults) {
  MemoryBudget budget(std::size_t{1} << 40);
  const ArmingResult result = arm(config_, budget, heap_, kMebibyte);
  if (!result.armed()) GTEST_SKIP() << result.message();
  EXPECT_EQ(result.message(), "");
  ProcessMemory memory;
  ProcessFigures figures;
  ASSERT_TRUE(memory.read(figures));
  EXPECT_GT(figures.locked, 0u);

  // The system makes the pages resident while it maps them, and counts that as the caller's faults.
  auto* page = static_cast<volatile char*>(
      ::mmap(nullptr, kMebibyte, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  ASSERT_NE(page, MAP_FAILED);
  const test::ThreadCost before = test::threadCost();
  for (std::size_t i = 0; i < kMebibyte; i += 4096) page[i] = 1;
  const test::ThreadCost cost = test::threadCost() - before;
  ::munmap(const_cast<char*>(page), kMebibyte);
  EXPECT_EQ(cost.minor_faults + cost.major_faults, 0u);
}

TEST_F(Arming, AResidentSetBeyondTheBudgetIsRefused) {
  MemoryBudget tiny(kMebibyte);
  const std::string names = arm(config_, tiny, heap_, 0).missingNames();
  EXPECT_THAT(names, HasSubstr("resident set"));
}

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
