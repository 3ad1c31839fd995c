#include <gmock/gmock.h>
#include <sched.h>
#include <sys/resource.h>

#include <stdexcept>
#include <utility>

#include "realtime/base/units.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/kernel/threads/watchdog.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::rt {
namespace {

using testing::ElementsAre, testing::IsEmpty;

ThreadConfig plain(const char* name) {
  ThreadConfig config{.name = name, .cpus = {}};
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
  EXPECT_THAT(thread.refused(), ElementsAre(testing::StartsWith("CPU 1023: ")));
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

using Remedy = Watchdog::Remedy;
using testing::ElementsAre, testing::IsEmpty, testing::Pair;

std::vector<std::pair<std::size_t, Remedy>> step(Watchdog& dog, std::int64_t now) {
  std::vector<std::pair<std::size_t, Remedy>> asked;
  dog.step(now, [&](std::size_t tier, Remedy remedy) { asked.emplace_back(tier, remedy); });
  return asked;
}

TEST(Watchdog, LeavesATierAloneThatBeats) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMillisecond_ns, false});
  dog.watch(nav, 0);
  for (std::int64_t t = 0; t < 1000 * kMillisecond_ns; t += 50 * kMillisecond_ns) {
    dog.heartbeat(nav).beat(t);
    EXPECT_THAT(step(dog, t + 10 * kMillisecond_ns), IsEmpty());
  }
  EXPECT_EQ(dog.state(nav).times_stuck, 0u);
}

TEST(Watchdog, LooksOnlyAtTiersThatAreWatched) {
  Watchdog dog;
  const std::size_t tier = dog.add({"rests", 100 * kMillisecond_ns, true});
  EXPECT_THAT(step(dog, 10'000 * kMillisecond_ns), IsEmpty());
  dog.watch(tier, 10'000 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 10'050 * kMillisecond_ns), IsEmpty());
  dog.unwatch(tier);
  EXPECT_THAT(step(dog, 20'000 * kMillisecond_ns), IsEmpty());
}

TEST(Watchdog, StartsADeadDeviceThreadAgainAtGrowingIntervalsAndSaysWhenItIsBack) {
  Watchdog dog;
  const std::size_t can = dog.add({"can", 100 * kMillisecond_ns, true});
  dog.watch(can, 0);
  std::vector<std::int64_t> restarts;
  for (std::int64_t t = 0; t <= 3000 * kMillisecond_ns; t += 50 * kMillisecond_ns)
    for (const auto& [tier, remedy] : step(dog, t)) {
      EXPECT_EQ(remedy, Remedy::kRestart);
      restarts.push_back(t / kMillisecond_ns);
    }
  EXPECT_THAT(restarts, ElementsAre(100, 300, 700, 1500));
  dog.heartbeat(can).beat(3010 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 3020 * kMillisecond_ns), ElementsAre(Pair(can, Remedy::kRecovered)));
  EXPECT_FALSE(dog.state(can).stuck);
  EXPECT_EQ(dog.state(can).times_stuck, 1u);
  EXPECT_EQ(dog.state(can).restarts, 4u);
  EXPECT_EQ(dog.state(can).longest_silent_ns, 3000 * kMillisecond_ns);
}

TEST(Watchdog, GivesUpOnceAndContinuesToTry) {
  Watchdog dog;
  const std::size_t can = dog.add({"can", 100 * kMillisecond_ns, true});
  dog.watch(can, 0);
  int given_up = 0;
  for (std::int64_t t = 0; t <= 60'000 * kMillisecond_ns; t += 100 * kMillisecond_ns)
    for (const auto& [tier, remedy] : step(dog, t)) given_up += remedy == Remedy::kGiveUp;
  EXPECT_EQ(given_up, 1);
  EXPECT_TRUE(dog.state(can).given_up);
  EXPECT_GT(dog.state(can).restarts, std::uint64_t{Watchdog::kMaxRestarts});
}

TEST(Watchdog, DoesNotRestartVisionAndKeepsTheOthersGoing) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMillisecond_ns, false});
  const std::size_t vision = dog.add({"vision", 100 * kMillisecond_ns, false});
  dog.watch(nav, 0);
  dog.watch(vision, 0);
  dog.heartbeat(nav).beat(190 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 200 * kMillisecond_ns), ElementsAre(Pair(vision, Remedy::kGiveUp)));
  dog.heartbeat(nav).beat(290 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 300 * kMillisecond_ns), IsEmpty());
}

TEST(Watchdog, ATierThatWasGivenUpRecoversWithItsNextBeat) {
  Watchdog dog;
  const std::size_t nav = dog.add({"nav", 100 * kMillisecond_ns, false});
  dog.watch(nav, 0);
  EXPECT_THAT(step(dog, 150 * kMillisecond_ns), ElementsAre(Pair(nav, Remedy::kGiveUp)));
  dog.heartbeat(nav).beat(160 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 170 * kMillisecond_ns), ElementsAre(Pair(nav, Remedy::kRecovered)));
}

TEST(Watchdog, ABeatWithATimeOutOfTheWorldNeitherHidesNorMakesASilence) {
  Watchdog dog;
  const std::size_t tier = dog.add({"nav", 100 * kMillisecond_ns, false});
  dog.watch(tier, 1000 * kMillisecond_ns);
  dog.heartbeat(tier).beat(1'000'000'000 * kMillisecond_ns);
  EXPECT_THAT(step(dog, 1050 * kMillisecond_ns), IsEmpty());
  EXPECT_THAT(step(dog, 1200 * kMillisecond_ns), ElementsAre(Pair(tier, Remedy::kGiveUp)));
  dog.heartbeat(tier).beat(-5);
  EXPECT_THAT(step(dog, 1210 * kMillisecond_ns), IsEmpty());
}

TEST(Watchdog, TakesNoHeap) {
  Watchdog dog;
  const std::size_t tier = dog.add({"can", 100 * kMillisecond_ns, true});
  const test::ThreadCost before = test::threadCost();
  dog.watch(tier, 0);
  int asked = 0;
  for (std::int64_t t = 0; t < 1000 * kMillisecond_ns; t += 10 * kMillisecond_ns)
    dog.step(t, [&](std::size_t, Remedy) { ++asked; });
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_GT(asked, 0);
}

}  // namespace
}  // namespace fathom::rt
