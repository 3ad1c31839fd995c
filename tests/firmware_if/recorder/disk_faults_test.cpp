// The recorder on a disk that refuses at its start, during the dive, and at its end.
#include <gmock/gmock.h>

#include <chrono>
#include <thread>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "tests/firmware_if/recorder/recorded_dive.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/bad_disk.hpp"
#include "tests/support/recording_gaps.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::BadDisk, test::DiskFault, test::SyntheticDive, ::testing::HasSubstr;

class DiskFaults : public test::RecordedDive {
 protected:
  // An earlier run, of the first 200 inputs.
  void recordEarlierRun() {
    const auto r = recorder();
    play(*r, 200);
    ASSERT_TRUE(r->close(30).log_whole);
  }
  // Works as the recorder's thread does, until it runs.
  static bool comesBack(Recorder& r) {
    const auto start = std::chrono::steady_clock::now();
    while (std::chrono::steady_clock::now() - start < std::chrono::seconds(20)) {
      r.work(20);
      if (r.state() == Recorder::State::kRunning) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }
  // Everything from number 0 is there, in order, but the images that are said to be lost.
  void expectAll(const Recorder& r, std::uint64_t inputs) {
    const SyntheticDive::Found found = expectInputs(inputs);
    EXPECT_EQ(found.skipped, 0u);
    EXPECT_EQ(found.images_lost, r.counters().images_dropped_disk);
    EXPECT_EQ(test::readGaps(folder_).images, found.images_lost);
    EXPECT_EQ(test::readGaps(folder_).inputs, 0u);
    EXPECT_EQ(r.counters().images_dropped_queue, 0u);
    LogInputReader log(folder_);
    LogInputReader::Entry entry;
    while (log.next(entry) == LogInputReader::Step::kInput)
      EXPECT_EQ(entry.input.arrival_utc_ns, dive_.input(entry.position).arrival_utc_ns);
    EXPECT_EQ(log.position(), inputs);
    EXPECT_EQ(player_.blocks().held(), 0u);
    for (const auto& image : std::filesystem::directory_iterator(MissionPaths(folder_).images()))
      EXPECT_NE(image.path().extension(), ".tmp") << image.path();
  }

  BadDisk disk_{folder_};
};

struct AtStart {
  const char* name;
  bool earlier_run;
  BadDisk::Order order;
  const char* says;
  friend void PrintTo(const AtStart& c, std::ostream* out) { *out << c.name; }
};

class DiskFaultsAtStart : public DiskFaults, public ::testing::WithParamInterface<AtStart> {};

TEST_P(DiskFaultsAtStart, KeepNoInputBackAndTheRecorderBeginsWhenTheDiskAnswers) {
  if (GetParam().earlier_run) recordEarlierRun();
  const std::uint64_t earlier = next_;
  const std::string before = earlier > 0 ? test::readText(MissionPaths(folder_).log()) : "";
  const auto rule = disk_.set(GetParam().order);
  const auto r = recorder();
  r->setFirstPosition(earlier);
  play(*r, 100);
  EXPECT_GT(disk_.hits(rule), 0u);
  EXPECT_EQ(r->state(), Recorder::State::kFailed);
  EXPECT_EQ(r->disk(), Recorder::Disk::kFull);
  EXPECT_THAT(r->failure(), HasSubstr(GetParam().says));
  EXPECT_EQ(r->counters().safe_position, earlier);
  EXPECT_EQ(r->counters().images_dropped_disk, 4u);
  EXPECT_GT(r->counters().raw_dropped, 0u);
  EXPECT_EQ(player_.blocks().held(), 0u);
  disk_.clear();

  EXPECT_TRUE(comesBack(*r));
  EXPECT_EQ(r->failure(), "");
  play(*r, 100);
  EXPECT_TRUE(r->close(30).log_whole);
  expectAll(*r, earlier + 200);
  EXPECT_EQ(r->counters().safe_position, earlier + 200);
  EXPECT_TRUE(test::readText(MissionPaths(folder_).log()).starts_with(before));
}

INSTANTIATE_TEST_SUITE_P(
    Every, DiskFaultsAtStart,
    ::testing::Values(
        AtStart{"FullAndNew", false, {.fault = DiskFault::kNoSpace}, "No space left on device"},
        AtStart{"ReadOnlyAndNew", false, {.fault = DiskFault::kReadOnly}, "Read-only file system"},
        AtStart{"BrokenAndNew", false, {.fault = DiskFault::kInputOutput}, "Input/output error"},
        AtStart{"LogCannotBeMade",
                false,
                {.fault = DiskFault::kNoSpace, .path = "sensors.lcmlog"},
                "sensors.lcmlog: cannot be opened (No space left on device)"},
        AtStart{"Full", true, {.fault = DiskFault::kNoSpace}, "No space left on device"},
        AtStart{"ReadOnly", true, {.fault = DiskFault::kReadOnly}, "Read-only file system"},
        AtStart{"Broken", true, {.fault = DiskFault::kInputOutput}, "Input/output error"},
        AtStart{"LogCannotBeRead",
                true,
                {.fault = DiskFault::kInputOutput, .path = "sensors.lcmlog", .calls = test::kReadCall},
                "sensors.lcmlog: cannot be read beyond byte"},
        AtStart{"LogCannotBeCut",
                true,
                {.fault = DiskFault::kInputOutput, .path = "sensors.lcmlog", .calls = test::kTruncateCall},
                "sensors.lcmlog: cannot be continued (Input/output error)"},
        AtStart{"MissionCannotBeRead",
                true,
                {.fault = DiskFault::kInputOutput, .path = "mission.toml", .calls = test::kReadCall},
                "mission.toml: cannot be read"}),
    [](const auto& of) { return std::string(of.param.name); });

TEST_F(DiskFaults, ImagesWaitForTheirFolderAlone) {
  disk_.set({.fault = DiskFault::kInputOutput, .path = "/img", .calls = test::kOpenCall});
  const auto r = recorder();
  play(*r, 100);
  EXPECT_EQ(r->state(), Recorder::State::kFailed);
  EXPECT_EQ(r->failure(), "img: cannot be written (Input/output error)");
  EXPECT_EQ(r->disk(), Recorder::Disk::kRoom);
  EXPECT_EQ(r->counters().inputs, 100u);
  EXPECT_EQ(r->counters().images_dropped_disk, 4u);
  disk_.clear();
  play(*r, 100);
  EXPECT_EQ(r->state(), Recorder::State::kRunning);
  EXPECT_TRUE(r->close(30).log_whole);
  expectAll(*r, 200);
}

TEST_F(DiskFaults, TheLogSaysHowManyInputsFoundNoRoomBeforeItCouldBeOpened) {
  recordEarlierRun();
  disk_.set({.fault = DiskFault::kReadOnly});
  const auto r = recorder();
  r->setFirstPosition(200);
  constexpr std::int64_t kFrom = SyntheticDive::kStartUtcNs + 200 * SyntheticDive::kInputIntervalNs;
  std::uint64_t refused = 0;
  for (int i = 0; i < 5000; ++i) {
    refused += r->offerInput({kFrom + i, Tick{}}) ? 0 : 1;
    if (i % 1000 == 0) r->work(20);
  }
  EXPECT_GT(refused, 800u);
  EXPECT_EQ(r->counters().inputs_dropped, refused);
  disk_.clear();
  EXPECT_TRUE(comesBack(*r));
  while (r->work(100)) continue;
  EXPECT_TRUE(r->offerInput({kFrom + 5000, Tick{}}));
  EXPECT_TRUE(r->close(30).log_whole);
  EXPECT_EQ(r->counters().safe_position, 5201u);
  EXPECT_EQ(test::readGaps(folder_).inputs, refused);

  LogInputReader log(folder_);
  LogInputReader::Entry entry;
  std::uint64_t missing = 0;
  for (LogInputReader::Step step; (step = log.next(entry)) != LogInputReader::Step::kEnd;) {
    if (step == LogInputReader::Step::kMissing) missing += entry.missing;
    if (step == LogInputReader::Step::kInput && entry.position >= 200) {
      EXPECT_EQ(entry.input.arrival_utc_ns, kFrom + static_cast<std::int64_t>(entry.position) - 200);
    }
  }
  EXPECT_EQ(missing, refused);
  EXPECT_EQ(log.position(), 5201u);
}

struct DuringTheDive {
  const char* name;
  BadDisk::Order order;
  bool of_log;
  friend void PrintTo(const DuringTheDive& c, std::ostream* out) { *out << c.name; }
};

class DiskFaultsDuringTheDive : public DiskFaults, public ::testing::WithParamInterface<DuringTheDive> {};

TEST_P(DiskFaultsDuringTheDive, LoseNoInputAndNothingThatWasSafe) {
  const auto r = recorder();
  play(*r, 110);
  const std::uint64_t safe = r->counters().safe_position;
  EXPECT_GE(safe, 54u);
  const auto rule = disk_.set(GetParam().order);
  play(*r, 100);
  EXPECT_GT(disk_.hits(rule), 0u);
  EXPECT_EQ(r->state(), Recorder::State::kFailed);
  EXPECT_THAT(r->failure(), HasSubstr(GetParam().of_log ? "sensors.lcmlog: " : "img: "));
  EXPECT_GT(r->counters().images_dropped_disk, 0u);
  EXPECT_GT(r->counters().write_failures, 0u);
  EXPECT_GE(r->counters().safe_position, safe);
  disk_.clear();
  // The log can be read all the while.
  EXPECT_GE(dive_.check(folder_).inputs, safe);
  play(*r, 100);
  EXPECT_EQ(r->state(), Recorder::State::kRunning);
  const Recorder::CloseResult closed = r->close(30);
  EXPECT_TRUE(closed.log_whole && closed.raw_auv) << closed.text;
  EXPECT_EQ(closed.text, "");
  EXPECT_EQ(r->state(), Recorder::State::kEnded);
  expectAll(*r, 310);
}

INSTANTIATE_TEST_SUITE_P(
    Every, DiskFaultsDuringTheDive,
    ::testing::Values(
        DuringTheDive{"LogFull", {.fault = DiskFault::kNoSpace, .path = "sensors.lcmlog"}, true},
        DuringTheDive{"LogReadOnly", {.fault = DiskFault::kReadOnly, .path = "sensors.lcmlog"}, true},
        DuringTheDive{"LogBroken", {.fault = DiskFault::kInputOutput, .path = "sensors.lcmlog"}, true},
        DuringTheDive{"LogNotSynced",
                      {.fault = DiskFault::kInputOutput, .path = "sensors.lcmlog", .calls = test::kSyncCall},
                      true},
        DuringTheDive{"LogWrittenShort", {.fault = DiskFault::kShortWrite, .path = "sensors.lcmlog"}, true},
        DuringTheDive{"ImagesFull", {.fault = DiskFault::kNoSpace, .path = "img/"}, false},
        DuringTheDive{"ImagesReadOnly", {.fault = DiskFault::kReadOnly, .path = "img/"}, false},
        DuringTheDive{"ImagesBroken", {.fault = DiskFault::kInputOutput, .path = "img/"}, false},
        DuringTheDive{"ImagesNotSynced",
                      {.fault = DiskFault::kInputOutput, .path = "img/", .calls = test::kSyncCall},
                      false},
        DuringTheDive{"ImagesNotRenamed",
                      {.fault = DiskFault::kInputOutput, .path = "img/", .calls = test::kRenameCall},
                      false},
        DuringTheDive{"ImagesWrittenShort", {.fault = DiskFault::kShortWrite, .path = "img/"}, false},
        DuringTheDive{"AllFull", {.fault = DiskFault::kNoSpace}, true},
        DuringTheDive{"AllReadOnly", {.fault = DiskFault::kReadOnly}, true},
        DuringTheDive{"AllBroken", {.fault = DiskFault::kInputOutput}, true}),
    [](const auto& of) { return std::string(of.param.name); });

TEST_F(DiskFaults, AtItsEndAreGivenUpInTimeAndCutNothing) {
  const auto r = recorder();
  play(*r, 100);
  disk_.set({.fault = DiskFault::kInputOutput, .path = "sensors.lcmlog", .calls = test::kSyncCall});
  play(*r, 110);
  const std::uint64_t safe = r->counters().safe_position;
  const auto start = std::chrono::steady_clock::now();
  const Recorder::CloseResult closed = r->close(0.3);
  const auto took = std::chrono::steady_clock::now() - start;
  EXPECT_GE(took, std::chrono::milliseconds(300));
  EXPECT_LT(took, std::chrono::seconds(20));
  EXPECT_FALSE(closed.log_whole);
  EXPECT_FALSE(closed.raw_auv);
  EXPECT_THAT(closed.text, HasSubstr(std::to_string(210 - safe) + " inputs are not on the disk for certain"));
  EXPECT_THAT(closed.text, HasSubstr("Input/output error"));
  EXPECT_EQ(r->state(), Recorder::State::kEnded);
  EXPECT_EQ(player_.blocks().held(), 0u);
  disk_.clear();
  // What the system has of the rest stays, too.
  expectInputs(210u);
}

TEST_F(DiskFaults, AtItsEndBeforeAnythingCouldBeOpenedAreSaidInWords) {
  disk_.set({.fault = DiskFault::kReadOnly});
  const auto r = recorder();
  play(*r, 60);
  const Recorder::CloseResult closed = r->close(0.1);
  EXPECT_FALSE(closed.log_whole || closed.raw_auv);
  EXPECT_THAT(closed.text, HasSubstr("nothing of this run was recorded"));
  EXPECT_THAT(closed.text, HasSubstr("Read-only file system"));
  EXPECT_EQ(player_.blocks().held(), 0u);
  EXPECT_FALSE(std::filesystem::exists(folder_));
}

TEST_F(DiskFaults, OfTheTextLeaveTheLogWholeAndNoHalfText) {
  for (const BadDisk::Order& order :
       {BadDisk::Order{.fault = DiskFault::kNoSpace, .path = "RAW.auv"},
        BadDisk::Order{.fault = DiskFault::kNoSpace, .path = "RAW.auv", .calls = test::kWriteCall},
        BadDisk::Order{.fault = DiskFault::kInputOutput, .path = "RAW.auv", .calls = test::kRenameCall}}) {
    const auto r = recorder();
    r->setFirstPosition(next_);
    play(*r, 100);
    const auto rule = disk_.set(order);
    const Recorder::CloseResult closed = r->close(30);
    EXPECT_GT(disk_.hits(rule), 0u);
    EXPECT_TRUE(closed.log_whole);
    EXPECT_FALSE(closed.raw_auv);
    EXPECT_THAT(closed.text, HasSubstr("no RAW.auv was written"));
    EXPECT_EQ(r->counters().safe_position, next_);
    disk_.clear();
    for (const auto& file : std::filesystem::directory_iterator(folder_))
      EXPECT_THAT(file.path().string(), ::testing::Not(HasSubstr("RAW.auv")));
  }
  const auto r = recorder();
  EXPECT_TRUE(r->close(30).raw_auv);
}

}  // namespace
}  // namespace fathom::io
