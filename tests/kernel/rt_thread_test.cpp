#include "realtime/kernel/threads/rt_thread.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/resource.h>

#include <array>
#include <atomic>
#include <cstring>
#include <stdexcept>

#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::StartsWith;

ThreadConfig plain(const char* name) {
  ThreadConfig config;
  config.name = name;
  config.stack_bytes = 1024 * 1024;  // a sanitizer puts nearly so much on it
  return config;
}

TEST(RtThread, RunsItsBodyUnderItsNameAndJoins) {
  RtThread thread(plain("a-name-that-is-too-long"));
  char name[16] = {};
  ASSERT_TRUE(thread.start([&] { ::pthread_getname_np(::pthread_self(), name, sizeof name); }));
  thread.join();
  EXPECT_STREQ(name, "a-name-that-is-");
  EXPECT_FALSE(thread.running());
  EXPECT_EQ(thread.failure(), "");
  thread.join();  // once more does nothing
}

TEST(RtThread, ItsStackIsResidentBeforeTheBodyBegins) {
  if (test::sanitized()) GTEST_SKIP() << "a sanitizer's shadow memory faults";
  RtThread thread(plain("stack"));
  test::ThreadCost cost;
  ASSERT_TRUE(thread.start([&] {
    (void)test::threadCost();  // its own first use
    const test::ThreadCost before = test::threadCost();
    std::array<volatile char, 400 * 1024> stack;
    for (std::size_t at = 0; at < stack.size(); at += 4096) stack[at] = 0;
    cost = test::threadCost() - before;
  }));
  thread.join();
  EXPECT_EQ(cost.minor_faults + cost.major_faults, 0u);
  EXPECT_EQ(cost.heap_calls, 0u);
}

TEST(RtThread, TheSameStackServesAFreshStart) {
  RtThread thread(plain("again"));
  std::atomic<int> runs{0};
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(thread.start([&] { ++runs; }));
    thread.join();
  }
  EXPECT_EQ(runs.load(), 3);
  EXPECT_EQ(thread.starts(), 3u);
}

TEST(RtThread, DoesNotStartWhileItsBodyRuns) {
  RtThread thread(plain("busy"));
  std::atomic<bool> stop{false};
  ASSERT_TRUE(thread.start([&] { stop.wait(false); }));
  EXPECT_TRUE(thread.running());
  EXPECT_FALSE(thread.start([] {}));
  stop = true;
  stop.notify_all();
}

TEST(RtThread, AnExceptionEndsTheBodyAloneAndItsTextIsKept) {
  RtThread thread(plain("throws"));
  ASSERT_TRUE(thread.start([] { throw std::runtime_error("device gone"); }));
  thread.join();
  EXPECT_EQ(thread.failure(), "device gone");
  ASSERT_TRUE(thread.start([] {}));
  thread.join();
  EXPECT_EQ(thread.failure(), "");
}

TEST(RtThread, GoesOnWithoutWhatTheSystemRefusesAndListsIt) {
  ThreadConfig config = plain("refused");
  config.cpus = {1023};
  RtThread thread(config);
  bool ran = false;
  ASSERT_TRUE(thread.start([&] { ran = true; }));
  thread.join();
  EXPECT_TRUE(ran);
  EXPECT_THAT(thread.refused(), ElementsAre(StartsWith("CPU 1023: ")));
}

TEST(RtThread, RunsWithTheGrantedPriorityOnTheGivenCpu) {
  ThreadConfig config = plain("fifo");
  config.fifo_priority = 11;
  cpu_set_t allowed;
  ASSERT_EQ(::sched_getaffinity(0, sizeof allowed, &allowed), 0);
  int cpu = 0;
  while (!CPU_ISSET(static_cast<std::size_t>(cpu), &allowed)) ++cpu;
  config.cpus = {cpu};
  RtThread thread(config);
  int policy = -1, ran_on = -1;
  sched_param parameters{};
  ASSERT_TRUE(thread.start([&] {
    ::pthread_getschedparam(::pthread_self(), &policy, &parameters);
    ran_on = ::sched_getcpu();
  }));
  thread.join();
  if (!thread.refused().empty()) GTEST_SKIP() << thread.refused().front();
  EXPECT_EQ(policy, SCHED_FIFO);
  EXPECT_EQ(parameters.sched_priority, 11);
  EXPECT_EQ(ran_on, cpu);
}

TEST(RtThread, ABestEffortThreadDoesNotInheritRealTime) {
  ThreadConfig outer_config = plain("outer");
  outer_config.fifo_priority = 11;
  RtThread outer(outer_config);
  RtThread inner(plain("inner"));
  int policy = -1;
  ASSERT_TRUE(outer.start([&] {
    const bool started = inner.start([&] {
      sched_param parameters{};
      ::pthread_getschedparam(::pthread_self(), &policy, &parameters);
    });
    if (started) inner.join();
  }));
  outer.join();
  if (!outer.refused().empty()) GTEST_SKIP() << outer.refused().front();
  EXPECT_EQ(policy, SCHED_OTHER);
}

}  // namespace
}  // namespace fathom::rt
