#include "realtime/kernel/time/periodic_loop.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/heap_counter.hpp"
#include "tests/support/manual_clock.hpp"

namespace fathom::rt {
namespace {

constexpr std::int64_t kPeriod = 10'000'000;

TEST(PeriodicLoop, WakesOnEveryDeadlineWithoutDrift) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  std::vector<std::int64_t> begun;
  for (int i = 0; i < 5; ++i)
    loop.runOnce([&] {
      begun.push_back(clock.monotonicNs());
      clock.advance(3'000'000);
    });
  for (std::size_t i = 0; i < begun.size(); ++i)
    EXPECT_EQ(begun[i], static_cast<std::int64_t>(i + 1) * kPeriod);
  EXPECT_EQ(loop.statistics().cycles, 5u);
  EXPECT_EQ(loop.statistics().skipped_cycles, 0u);
  EXPECT_EQ(loop.statistics().max_body_ns, 3'000'000);
  EXPECT_EQ(loop.statistics().jitter_ns.max(), 0);
}

TEST(PeriodicLoop, SkipsAndCountsTheDeadlinesThatALongBodyMissed) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  loop.runOnce([&] { clock.advance(25'000'000); });  // begun at 10 ms, ends at 35 ms: misses 20 and 30 ms
  EXPECT_EQ(loop.statistics().skipped_cycles, 2u);
  EXPECT_EQ(loop.nextDeadlineNs(), 4 * kPeriod);
  loop.runOnce([&] { EXPECT_EQ(clock.monotonicNs(), 4 * kPeriod); });
  EXPECT_EQ(loop.statistics().skipped_cycles, 2u);
  EXPECT_EQ(loop.statistics().max_body_ns, 25'000'000);
}

TEST(PeriodicLoop, ABodyThatJustFillsItsPeriodSkipsNoDeadline) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  for (int i = 0; i < 3; ++i) loop.runOnce([&] { clock.advance(kPeriod); });
  EXPECT_EQ(loop.statistics().skipped_cycles, 0u);
  EXPECT_EQ(loop.statistics().jitter_ns.max(), 0);
}

// A clock that wakes late, as a loaded machine does.
class LateClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return inner_.monotonicNs(); }
  [[nodiscard]] std::int64_t utcNs() const noexcept override { return inner_.utcNs(); }
  void sleepUntil(std::int64_t monotonic_ns) noexcept override {
    inner_.sleepUntil(monotonic_ns);
    inner_.advance(lateness_);
    lateness_ += 1000;
  }

 private:
  test::ManualClock inner_;
  std::int64_t lateness_ = 1000;
};

TEST(PeriodicLoop, MeasuresHowLateEachCycleBegins) {
  LateClock clock;
  PeriodicLoop loop(clock, kPeriod);
  for (int i = 0; i < 4; ++i) loop.runOnce([] {});
  EXPECT_EQ(loop.statistics().jitter_ns.min(), 1000);
  EXPECT_EQ(loop.statistics().jitter_ns.max(), 4000);
  EXPECT_EQ(loop.statistics().jitter_ns.count(), 4u);
}

TEST(PeriodicLoop, RunsUntilTheBodySaysStop) {
  test::ManualClock clock;
  PeriodicLoop loop(clock, kPeriod);
  int cycles = 0;
  loop.run([&] { return ++cycles < 7; });
  EXPECT_EQ(cycles, 7);
  EXPECT_EQ(clock.monotonicNs(), 7 * kPeriod);
}

TEST(PeriodicLoop, CyclesOnTheRealClockWithoutHeapCalls) {
  RealClock clock;
  PeriodicLoop loop(clock, 1'000'000);
  const test::ThreadCost before = test::threadCost();
  for (int i = 0; i < 10; ++i) loop.runOnce([] {});
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_EQ(loop.statistics().cycles, 10u);
}

}  // namespace
}  // namespace fathom::rt
