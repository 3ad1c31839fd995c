#include <gtest/gtest.h>

#include "realtime/base/units.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"
#include "realtime/onboard/live/hard_tier.hpp"
#include "realtime/onboard/live/resume.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kHour = 3600 * kSecond_ns;

class VehicleClockOffset : public testing::Test {
 protected:
  test::TemporaryFolder folder;
  std::filesystem::path state = folder.path() / "state";
};

TEST_F(VehicleClockOffset, IsTheSystemsForADiveThatBeginsAndKeptUntilTheMachineBoots) {
  std::int64_t behind_ns = -1;
  const std::int64_t first = vehicleClockOffset(state, 0, &behind_ns);
  EXPECT_LT(std::abs(first - rt::VehicleClock::systemOffsetNs()), kSecond_ns);
  EXPECT_EQ(behind_ns, 0);
  const std::int64_t last_ns = rt::RealClock().monotonicNs() + first;
  EXPECT_EQ(vehicleClockOffset(state, last_ns - kSecond_ns), first);
  std::ofstream(state / "clock.txt") << "another-boot 5\n";
  EXPECT_LT(std::abs(vehicleClockOffset(state) - rt::VehicleClock::systemOffsetNs()), kSecond_ns);
}

// The log's end is an hour ahead: the clock was set back, or the machine booted with it behind.
TEST_F(VehicleClockOffset, ADiveWithALogAheadContinuesFromItsEndAndItsTicksAdvance) {
  const std::int64_t last_ns = rt::RealClock().utcNs() + kHour;
  std::int64_t behind_ns = 0;
  const rt::VehicleClock clock(vehicleClockOffset(state, last_ns, &behind_ns));
  EXPECT_GT(behind_ns, kHour - kSecond_ns);
  EXPECT_GT(clock.utcNs(), last_ns);
  EXPECT_LT(clock.utcNs(), last_ns + 10 * kSecond_ns);
  InputSequencer sequencer;
  sequencer.startAfter(last_ns);
  const std::int64_t now_ns = clock.utcNs();
  EXPECT_EQ(sequencer.own(now_ns, io::Tick{}).arrival_utc_ns, now_ns) << "not held at the log's end";
  EXPECT_EQ(sequencer.own(now_ns + kSecond_ns, io::Tick{}).arrival_utc_ns, now_ns + kSecond_ns);

  // Killed and started again on the same boot: the same clock continues.
  const rt::VehicleClock again(vehicleClockOffset(state, now_ns, &behind_ns));
  EXPECT_EQ(behind_ns, 0);
  EXPECT_LT(std::abs(again.utcNs() - clock.utcNs()), kSecond_ns);
}

TEST_F(VehicleClockOffset, AFolderThatCannotBeWrittenHoldsUpNoStart) {
  test::writeText((folder.path() / "file").string(), "");
  const std::int64_t last_ns = rt::RealClock().utcNs() + kHour;
  const rt::VehicleClock clock(vehicleClockOffset(folder.path() / "file" / "state", last_ns));
  EXPECT_GT(clock.utcNs(), last_ns);
}

}  // namespace
}  // namespace fathom::onboard
