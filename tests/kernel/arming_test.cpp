#include "realtime/kernel/threads/arming.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <functional>
#include <string>

#include "realtime/base/units.hpp"
#include "realtime/kernel/memory/process_memory.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

using testing::HasSubstr;
using testing::Not;

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

}  // namespace
}  // namespace fathom::rt
