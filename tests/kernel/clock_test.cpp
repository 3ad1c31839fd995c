#include <gtest/gtest.h>

#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/kernel/time/clock_line.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"

namespace fathom::rt {
namespace {

TEST(RealClock, SleepsUntilTheMomentAskedForAndNotLess) {
  RealClock clock;
  const std::int64_t wanted = clock.monotonicNs() + 2'000'000;
  clock.sleepUntil(wanted);
  EXPECT_GE(clock.monotonicNs(), wanted);
}

TEST(RealClock, ReturnsAtOnceForAMomentThatIsPast) {
  RealClock clock;
  clock.sleepUntil(0);
  clock.sleepUntil(-5);
  clock.sleepUntil(clock.monotonicNs() - 1);
}

TEST(RealClock, CountsUtcFromTheUnixEpoch) {
  const RealClock clock;
  constexpr std::int64_t kStartOf2024 = 1'704'067'200'000'000'000;
  EXPECT_GT(clock.utcNs(), kStartOf2024);
}

TEST(ClockLine, GoesThroughPointsOfAClockThatDrifts) {
  ClockLine line;
  for (int i = 0; i < 200; ++i) line.add({10.0 * i, 3 + 40e-6 * 10.0 * i});
  EXPECT_EQ(line.points().size(), ClockLine::Points::capacity());
  EXPECT_NEAR(line.rate(), 40e-6, 1e-12);
  EXPECT_NEAR(line.at(3600), 3 + 40e-6 * 3600, 1e-9);
}

TEST(ClockLine, WeightsAPointByItsSigma) {
  ClockLine line;
  line.add({0, 1, 1e-6});
  line.add({1, 1, 1e-6});
  line.add({0.5, 2, 1e-3});
  EXPECT_NEAR(line.at(0.5), 1, 1e-5);
}

TEST(ClockLine, InventsNoRateFromAShortHistoryWhereThereIsAPrior) {
  ClockLine free, held(50e-6);
  for (ClockLine* line : {&free, &held}) {
    line->add({0, 0, 1e-3});
    line->add({1, 2e-3, 1e-3});
  }
  EXPECT_NEAR(free.rate(), 2e-3, 1e-12);
  EXPECT_LT(held.rate(), 10e-6);
}

TEST(ClockLine, StaysAsItIsWithoutPointsAndLevelAfterARestart) {
  ClockLine line;
  line.add({0, 1});
  line.add({10, 2});
  line.forgetPoints();
  EXPECT_NEAR(line.at(20), 3, 1e-12);
  line.hold(5);
  EXPECT_EQ(line.at(20), 5);
  line.restart();
  EXPECT_EQ(line.at(20), 0);
}

TEST(RetryWait, GrowsWithEachFailureToItsLongestAndResetsAfterASuccess) {
  RetryWait wait(10, 35);
  EXPECT_TRUE(wait.due(INT64_MIN)) << "nothing has failed yet";
  wait.failed(0);
  EXPECT_FALSE(wait.due(9));
  EXPECT_TRUE(wait.due(10));
  wait.failed(10);
  EXPECT_FALSE(wait.due(29));
  EXPECT_TRUE(wait.due(30));
  for (int i = 0; i < 100; ++i) wait.failed(30);
  EXPECT_FALSE(wait.due(64));
  EXPECT_TRUE(wait.due(65));
  wait.succeeded();
  EXPECT_TRUE(wait.due(0));
  wait.failed(0);
  EXPECT_TRUE(wait.due(10));
}

constexpr std::int64_t kHour = 3600 * kSecond_ns;
constexpr std::int64_t kUtc = 1'700'000'000 * kSecond_ns;  // when the machine booted

// A machine's clocks, as a test sets them.
struct Machine final : Clock {
  std::int64_t monotonic_ns = 100 * kSecond_ns, utc_ns = kUtc + 100 * kSecond_ns;
  void pass(std::int64_t ns) {
    monotonic_ns += ns;
    utc_ns += ns;
  }
  [[nodiscard]] std::int64_t offset() const { return utc_ns - monotonic_ns; }
  [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return monotonic_ns; }
  [[nodiscard]] std::int64_t utcNs() const noexcept override { return utc_ns; }
  void sleepUntil(std::int64_t) noexcept override {}
};

TEST(VehicleTime, BeginsWithTheSystemsWhereTheDiveOrItsLogSaysNothingElse) {
  const Machine machine;
  for (const std::int64_t last_ns : {std::int64_t{0}, machine.utc_ns - kHour}) {
    const ClockStart start = beginVehicleTime(machine.offset(), {}, machine.monotonic_ns, last_ns);
    EXPECT_EQ(start.offset_ns, machine.offset());
    EXPECT_EQ(start.behind_ns, 0);
  }
}

TEST(VehicleTime, GoesOnBehindTheLogWhenTheMachineBootedWithItsClockBehind) {
  Machine machine;
  const std::int64_t last_ns = machine.utc_ns;
  machine.utc_ns = 5 * kSecond_ns;  // 1970: no battery
  machine.monotonic_ns = 5 * kSecond_ns;
  const ClockStart start = beginVehicleTime(machine.offset(), {}, machine.monotonic_ns, last_ns);
  const VehicleClock clock(start.offset_ns, machine);
  EXPECT_EQ(clock.utcNs(), last_ns + 1'000'000);
  EXPECT_EQ(start.behind_ns, last_ns + 1'000'000 - machine.utc_ns);
  machine.pass(kSecond_ns);
  EXPECT_EQ(clock.utcNs(), last_ns + kSecond_ns + 1'000'000)
      << "it does not stand still until UTC catches up";
  EXPECT_EQ(clock.systemStepNs(), 0) << "nobody has set the system's clock";
}

TEST(VehicleTime, GoesOnBehindALogThatWasWrittenWithTheClockAhead) {
  Machine machine;
  const std::int64_t last_ns = machine.utc_ns + kHour;
  for (const std::optional<std::int64_t> kept : {std::optional<std::int64_t>(), {machine.offset()}}) {
    const ClockStart start = beginVehicleTime(machine.offset(), kept, machine.monotonic_ns, last_ns);
    EXPECT_EQ(machine.monotonic_ns + start.offset_ns, last_ns + 1'000'000);
    EXPECT_EQ(start.behind_ns, kHour + 1'000'000);
  }
}

TEST(VehicleTime, KeepsItsOffsetSinceTheMachineBootedWhenTheSystemsClockIsSet) {
  Machine machine;
  const std::int64_t kept = machine.offset();
  for (const std::int64_t step : {-kHour, kHour}) {
    machine.utc_ns += step;
    machine.pass(2 * kSecond_ns);
    const std::int64_t last_ns = machine.monotonic_ns - kSecond_ns + kept;
    const ClockStart start = beginVehicleTime(machine.offset(), kept, machine.monotonic_ns, last_ns);
    EXPECT_EQ(start.offset_ns, kept);
    EXPECT_EQ(start.behind_ns, 0);
  }
}

TEST(VehicleClock, SaysByHowMuchItDiffersFromTheSystemsUtcAndHowFarThatWasSet) {
  Machine machine;
  const VehicleClock clock(machine.offset() + 3 * kSecond_ns, machine);
  EXPECT_EQ(clock.utcErrorNs(), 3 * kSecond_ns);
  EXPECT_EQ(clock.systemStepNs(), 0);
  machine.utc_ns += 10 * kSecond_ns;
  EXPECT_EQ(clock.utcErrorNs(), -7 * kSecond_ns);
  EXPECT_EQ(clock.systemStepNs(), 10 * kSecond_ns);
  // A stamp that another program makes now, by the system's UTC.
  EXPECT_EQ(machine.utc_ns + clock.utcErrorNs(), clock.utcNs());
}

TEST(VehicleClock, AThreadThatIsPutOffBetweenTwoClocksDoesNotPassForAStep) {
  // Each reading takes longer than the one before, and the first one no time.
  struct Slow final : Clock {
    mutable std::int64_t now = 0, delay = 0;
    [[nodiscard]] std::int64_t monotonicNs() const noexcept override { return now; }
    [[nodiscard]] std::int64_t utcNs() const noexcept override {
      now += delay;
      delay += 7 * kSecond_ns;
      return now + kUtc;
    }
    void sleepUntil(std::int64_t) noexcept override {}
  } slow;
  const VehicleClock clock(kUtc, slow);
  slow.delay = 0;
  EXPECT_EQ(clock.utcErrorNs(), 0);
}

TEST(ClockHealth, IsUnsureUntilTheSystemsClockIsSynchronisedAndAgreesToASecond) {
  ClockHealth health;
  EXPECT_TRUE(health.unsure());
  health.look({false, 0});
  EXPECT_TRUE(health.unsure()) << "a clock that nobody disciplines agrees with itself";
  health.look({true, kSecond_ns});
  EXPECT_FALSE(health.unsure());
  health.look({false, kHour});
  EXPECT_FALSE(health.unsure()) << "what an unsynchronised clock shows says nothing; UTC was known";
  health.look({true, kSecond_ns + 1});
  EXPECT_TRUE(health.unsure());
  health.look({true, -kSecond_ns - 1});
  EXPECT_TRUE(health.unsure());
}

TEST(SystemClock, TheKernelReportsWhetherItIsSynchronised) {
  EXPECT_TRUE(readSystemClock().known);
}

}  // namespace
}  // namespace fathom::rt
