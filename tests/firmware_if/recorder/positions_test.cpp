// Positions of inputs, as the recorder gives them and as the log says them.
#include <gmock/gmock.h>

#include "firmware_if/mission/log/log_inputs.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::DivePlayer;
using test::SyntheticDive;
using Step = LogInputReader::Step;

class Positions : public ::testing::Test {
 protected:
  std::unique_ptr<Recorder> recorder() {
    RecorderConfig config;
    config.planned_hours = 0;
    config.image_reserve_mib = config.log_reserve_mib = 0;
    auto r = std::make_unique<Recorder>(folder_, dive_.mission(), dive_.rig(), config, player_.viewOf(),
                                        player_.release());
    r->setFirstPosition(offered_);
    EXPECT_EQ(r->counters().safe_position, offered_);
    return r;
  }
  // The input says its own position, by its time.
  bool offer(Recorder& r) {
    const auto position = static_cast<std::int64_t>(offered_++);
    return r.offerInput({SyntheticDive::kStartUtcNs + position, Tick{}});
  }
  static void workOff(Recorder& r) {
    while (r.work(100)) continue;
  }
  // Every input of the log stands where it was offered; gives how many are missing.
  std::uint64_t checkLog() {
    LogInputReader log(folder_);
    LogInputReader::Entry entry;
    std::uint64_t missing = 0;
    for (Step step; (step = log.next(entry)) != Step::kEnd;) {
      if (step == Step::kMissing) missing += entry.missing;
      if (step == Step::kInput) {
        EXPECT_EQ(entry.input.arrival_utc_ns - SyntheticDive::kStartUtcNs,
                  static_cast<std::int64_t>(entry.position));
      }
    }
    EXPECT_EQ(log.position(), offered_);
    EXPECT_EQ(log.damaged(), 0u);
    return missing;
  }

  test::TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_.path() / "dive";
  SyntheticDive::Config dive_config_{64, 48, 50};
  SyntheticDive dive_{dive_config_};
  DivePlayer player_{dive_, dive_config_, 16};
  std::uint64_t offered_ = 0;  // in all runs
};

TEST_F(Positions, ContinueOverRestartsAndOverInputsWithoutRoom) {
  std::uint64_t refused = 0;
  for (int run = 0; run < 3; ++run) {
    const auto r = recorder();
    for (int i = 0; i < 5000; ++i) refused += offer(*r) ? 0 : 1;
    workOff(*r);
    for (int i = 0; i < 10; ++i) EXPECT_TRUE(offer(*r));
    EXPECT_TRUE(r->close(30).log_whole);
    EXPECT_EQ(r->counters().safe_position, offered_);
    EXPECT_GT(refused, 900u * static_cast<unsigned>(run + 1));
  }
  EXPECT_EQ(checkLog(), refused);
}

TEST_F(Positions, CountWhatFoundNoRoomAtTheVeryEnd) {
  std::uint64_t refused = 0;
  {
    const auto r = recorder();
    for (int i = 0; i < 5000; ++i) refused += offer(*r) ? 0 : 1;
    const std::uint64_t before = r->counters().safe_position;
    EXPECT_EQ(before, 0u);
    EXPECT_TRUE(r->close(30).log_whole);
    EXPECT_EQ(r->counters().safe_position, 5000u);
  }
  EXPECT_GT(refused, 0u);
  EXPECT_EQ(checkLog(), refused);
}

TEST_F(Positions, OfDecisionsAreTheirOwnAndTakeNoneOfTheInputs) {
  const auto r = recorder();
  std::uint64_t refused = 0;
  for (int i = 0; i < 5000; ++i)
    refused += r->offerDecision({SyntheticDive::kStartUtcNs, Decision{1, 0, true}}) ? 0 : 1;
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(offer(*r));
  workOff(*r);
  EXPECT_TRUE(r->offerDecision({SyntheticDive::kStartUtcNs, Decision{2, 0, true}}));
  EXPECT_TRUE(r->close(30).log_whole);
  EXPECT_GT(refused, 0u);
  EXPECT_EQ(r->counters().decisions_dropped, refused);
  EXPECT_EQ(r->counters().decisions_safe, 5001u);
  EXPECT_EQ(r->counters().safe_position, 10u);
  EXPECT_EQ(checkLog(), 0u);
}

TEST_F(Positions, AreSafeOnlyWhenTheDiskHasThem) {
  const auto r = recorder();
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(offer(*r));
  r->work(20);  // handed to the system, and not yet synced
  EXPECT_EQ(r->counters().inputs, 10u);
  EXPECT_EQ(r->counters().safe_position, 0u);
  EXPECT_TRUE(r->close(30).log_whole);
  EXPECT_EQ(r->counters().safe_position, 10u);
}

}  // namespace
}  // namespace fathom::io
