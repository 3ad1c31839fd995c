#include "firmware_if/recorder/recorder.hpp"

#include <gmock/gmock.h>
#include <lcm/lcm.h>
#include <sys/stat.h>

#include <chrono>
#include <map>
#include <thread>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "tests/firmware_if/recorder/recorded_dive.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/recording_gaps.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::SyntheticDive, ::testing::IsEmpty;

constexpr double kMostCloseS = 30;

class RecorderTest : public test::RecordedDive {
 protected:
  static RecorderConfig smallConfig() { return bareConfig(0.1); }
  std::unique_ptr<Recorder> recorder(const RecorderConfig& config = smallConfig()) {
    return RecordedDive::recorder(config);
  }
  // Offers inputs [from, to).
  void play(Recorder& recorder, std::uint64_t from, std::uint64_t to) {
    next_ = from;
    RecordedDive::play(recorder, to - from);
  }
  // How many events of each channel the log holds, and gaps by their text.
  std::map<std::string, int> channels() const {
    LogEventReader log(MissionPaths(folder_).log());
    LogEvent event;
    std::map<std::string, int> count;
    while (log.next(event)) {
      ++count[std::string(event.channel)];
      if (event.channel != kGapChannel) continue;
      const auto gap = decodeGap(event.data);
      if (gap) count[gap->what.empty() ? "gap of " + std::to_string(gap->count) : gap->what] += 1;
    }
    EXPECT_EQ(log.damagedStretches(), 0u);
    return count;
  }
};

TEST_F(RecorderTest, TheLogHoldsEveryInputInOrderAndEveryImageThatItNames) {
  {
    const auto r = recorder();
    play(*r, 0, 1000);
    EXPECT_TRUE(r->close(kMostCloseS).log_whole);
    EXPECT_EQ(r->counters().inputs, 1000u);
    EXPECT_EQ(r->counters().inputs_safe, 1000u);
    EXPECT_EQ(r->counters().images, 40u);
    EXPECT_EQ(r->counters().images_without_input, 0u);
    EXPECT_EQ(r->disk(), Recorder::Disk::kRoom);
  }
  const SyntheticDive::Found found = expectInputs(1000u);
  EXPECT_EQ(found.skipped, 0u);
  EXPECT_EQ(found.images, 40u);
  EXPECT_EQ(player_.blocks().held(), 0u);
  auto count = channels();
  EXPECT_EQ(count["RAW_DVL"], 50);
  EXPECT_EQ(count["ACFR_AUV_VIS_RAWLOG"], 40);
  EXPECT_EQ(count["PAROSCI"], count["FATHOM_DEPTH"]);
  EXPECT_EQ(count[std::string(kGapChannel)], 0);
  EXPECT_TRUE(MissionPaths(folder_).rawAuv());
  EXPECT_EQ(test::readGaps(folder_).images, 0u);
}

TEST_F(RecorderTest, OfferingTakesNoMemory) {
  const auto r = recorder();
  const OnboardInput input = dive_.input(1);
  const std::vector<std::uint8_t> bytes(500, 7);
  const rt::ThreadCost before = test::threadCost();
  for (int i = 0; i < 100; ++i) {
    EXPECT_TRUE(r->offerInput(input));
    EXPECT_TRUE(r->offerDecision({input.arrival_utc_ns, Decision{1, 2, false}}));
    EXPECT_TRUE(r->offerRaw(1, input.arrival_utc_ns, "RAW_CAN", bytes));
    EXPECT_TRUE(r->offerMessage(2, input.arrival_utc_ns, "FATHOM_HEALTH", bytes));
  }
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  while (r->work(100)) continue;
  EXPECT_EQ(r->counters().decisions, 100u);
  EXPECT_EQ(r->counters().messages, 100u);
}

TEST_F(RecorderTest, AnExposureWithoutPixelsIsNamedAsLostBeforeItsEvent) {
  RecorderConfig config = smallConfig();
  config.image_queue = 1;
  const auto r = recorder(config);
  // Two left exposures before the recorder works: the second finds the queue full.
  for (std::uint64_t n = 0; n < 60; ++n) EXPECT_TRUE(player_.offer(*r, n));
  EXPECT_EQ(r->counters().images_dropped_queue, 2u);
  EXPECT_TRUE(r->close(kMostCloseS).log_whole);
  const SyntheticDive::Found found = expectInputs(60u);
  EXPECT_EQ(found.images, 2u);
  EXPECT_EQ(found.images_lost, 2u);
  EXPECT_EQ(test::readGaps(folder_).images, 2u);
  EXPECT_EQ(player_.blocks().held(), 0u);
}

TEST_F(RecorderTest, ADiskTooSlowForImagesLosesImagesAndNotInputs) {
  // Writing the pixels takes 0.5 s for the first exposure of each camera.
  int views = 0;
  const Recorder::ViewOf quick = player_.viewOf();
  const auto slow = [&](const CameraFrame& frame) {
    if (++views <= 2) std::this_thread::sleep_for(std::chrono::milliseconds(500));
    return quick(frame);
  };
  Recorder r(folder_, dive_.mission(), dive_.rig(), smallConfig(), slow, player_.release());
  play(r, 0, 400);
  EXPECT_TRUE(r.close(kMostCloseS).log_whole);
  EXPECT_EQ(r.counters().images_dropped_queue, 2u);  // the next pair; the one after it was quick
  const SyntheticDive::Found found = expectInputs(400u);
  EXPECT_EQ(found.images, 14u);
  EXPECT_EQ(found.images_lost, 2u);
}

TEST_F(RecorderTest, InputsThatFindNoRoomLeaveAGapWithTheirNumber) {
  const auto r = recorder();
  std::uint64_t refused = 0;
  for (int i = 0; i < 5000; ++i) refused += r->offerInput({SyntheticDive::kStartUtcNs + i, Tick{}}) ? 0 : 1;
  EXPECT_GT(refused, 0u);
  while (r->work(100)) continue;
  EXPECT_TRUE(r->offerInput({SyntheticDive::kStartUtcNs + 5000, Tick{}}));
  EXPECT_TRUE(r->close(kMostCloseS).log_whole);
  EXPECT_EQ(r->counters().inputs_dropped, refused);
  EXPECT_EQ(channels()["gap of " + std::to_string(refused)], 1);
  EXPECT_EQ(test::readGaps(folder_).inputs, refused);
}

TEST_F(RecorderTest, RawBytesThatFindNoRoomAreCountedInTheLog) {
  RecorderConfig config = smallConfig();
  config.raw_queue_kib = 16;
  const auto r = recorder(config);
  const std::vector<std::uint8_t> bytes(1000, 3);
  int refused = 0;
  for (int i = 0; i < 30; ++i)
    refused += r->offerRaw(0, SyntheticDive::kStartUtcNs + i, "RAW_CAN", bytes) ? 0 : 1;
  EXPECT_GT(refused, 10);
  EXPECT_FALSE(r->offerRaw(99, SyntheticDive::kStartUtcNs, "RAW_CAN", bytes));
  while (r->work(100)) continue;
  EXPECT_EQ(test::readGaps(folder_).raw_entries, static_cast<std::uint64_t>(refused));
  EXPECT_EQ(r->counters().raw_dropped, static_cast<std::uint64_t>(refused));
}

TEST_F(RecorderTest, AfterACrashRecordingContinuesBehindTheLastWholeEntry) {
  const MissionPaths paths(folder_);
  {
    const auto r = recorder();
    play(*r, 0, 300);
  }  // as by kill: nothing is closed
  const auto whole = std::filesystem::file_size(paths.log());
  test::writeText(paths.images() / "PR_20231114_221500_000_LC16.tif.tmp", "half");
  std::filesystem::copy_file(paths.images() / imageOf(dive_.input(253))->file_name.view(),
                             paths.images() / "PR_20231114_221500_000_LC16.tif");
  std::ofstream(paths.log(), std::ios::binary | std::ios::app) << "\xED\xA1\xDA\x01 and no more";
  {
    const auto r = recorder();
    EXPECT_EQ(r->found().log_bytes, whole);
    EXPECT_EQ(r->found().log_bytes_cut, 16u);
    EXPECT_EQ(r->found().half_images_removed, 1u);
    EXPECT_EQ(r->found().images_without_event, 1u);
    play(*r, 300, 500);
    EXPECT_TRUE(r->close(kMostCloseS).log_whole);
  }
  const SyntheticDive::Found found = expectInputs(500u);
  EXPECT_EQ(found.skipped, 0u);
  EXPECT_TRUE(std::filesystem::exists(paths.images() / "PR_20231114_221500_000_LC16.tif"));
}

TEST_F(RecorderTest, RoomForThePlanIsTakenBeforehandAndGivenBack) {
  const auto blocks = [&] {
    struct stat status = {};
    EXPECT_EQ(::stat(MissionPaths(folder_).log().c_str(), &status), 0);
    return std::pair(static_cast<std::uint64_t>(status.st_size),
                     static_cast<std::uint64_t>(status.st_blocks) * 512);
  };
  RecorderConfig config = smallConfig();
  config.planned_hours = 1;
  const std::uint64_t planned = plannedBytes(config, dive_.mission(), dive_.rig()).log;
  const auto r = recorder(config);
  play(*r, 0, 100);
  if (blocks().second < planned) GTEST_SKIP() << "this file system takes no room beforehand";
  EXPECT_LT(blocks().first, std::uint64_t{1} << 20);
  EXPECT_TRUE(r->close(kMostCloseS).log_whole);
  EXPECT_LT(blocks().second, std::uint64_t{1} << 20);
  EXPECT_THAT(dive_.check(folder_).wrong, IsEmpty());
}

TEST_F(RecorderTest, LcmReadsTheLogWhileItIsRecordedWithItsRoomTaken) {
  RecorderConfig config = smallConfig();
  config.planned_hours = 1;
  const auto r = recorder(config);
  play(*r, 0, 200);
  std::map<std::string, int> count;
  lcm_eventlog_t* log = lcm_eventlog_create(MissionPaths(folder_).log().c_str(), "r");
  ASSERT_NE(log, nullptr);
  while (lcm_eventlog_event_t* event = lcm_eventlog_read_next_event(log)) {
    ++count[std::string(event->channel, static_cast<std::size_t>(event->channellen))];
    lcm_eventlog_free_event(event);
  }
  lcm_eventlog_destroy(log);
  EXPECT_EQ(count, channels());
  EXPECT_EQ(count["RDI"], 10);
}

TEST_F(RecorderTest, AnotherDivesFolderAndAForeignLogAreRefused) {
  EXPECT_TRUE(recorder()->close(kMostCloseS).log_whole);
  MissionConfig other = dive_.mission();
  other.dive_id = 13;
  EXPECT_THAT(test::refusal([&] {
                Recorder r(folder_, other, dive_.rig(), smallConfig(), player_.viewOf(), player_.release());
              }),
              ::testing::HasSubstr("give each dive its own folder"));
  test::writeText(MissionPaths(folder_).log(), std::string(100, 'x'));
  EXPECT_THAT(test::refusal([&] { recorder(); }), ::testing::HasSubstr("is no LCM event log; move it away"));
}

TEST_F(RecorderTest, ALogOfWhichNotOneEntryWasWholeIsBegunAgain) {
  EXPECT_TRUE(recorder()->close(kMostCloseS).log_whole);
  for (const std::string& begin : {std::string(50000, '\0'), std::string("\xED\xA1\xDA\x01\0\0", 6)}) {
    test::writeText(MissionPaths(folder_).log(), begin);
    const auto r = recorder();
    EXPECT_EQ(r->found().log_bytes_cut, begin.size());
    EXPECT_EQ(r->found().log_bytes, 0u);
  }
}

TEST_F(RecorderTest, TwoRunsOfTheSameDiveMakeTheSameLog) {
  {
    const auto r = recorder();
    play(*r, 0, 200);
    EXPECT_TRUE(r->close(kMostCloseS).log_whole);
  }
  const std::string first = test::readText(MissionPaths(folder_).log());
  folder_ = parent_.path() / "again";
  {
    const auto r = recorder();
    play(*r, 0, 200);
    EXPECT_TRUE(r->close(kMostCloseS).log_whole);
  }
  EXPECT_EQ(test::readText(MissionPaths(folder_).log()), first);
}

}  // namespace
}  // namespace fathom::io
