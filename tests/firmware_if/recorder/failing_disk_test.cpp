// A disk that is slow to sync, or that fails to.
#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "firmware_if/recorder/log_stage.hpp"
#include "tests/firmware_if/recorder/recorded_dive.hpp"
#include "tests/support/bad_disk.hpp"
#include "tests/support/program_run.hpp"
#include "tests/support/recording_gaps.hpp"

namespace fathom::io {
namespace {

using test::BadDisk, test::DiskFault, test::readText, test::refusal, test::SyntheticDive;
using ::testing::HasSubstr;

class FailingDisk : public test::RecordedDive {
 protected:
  test::BadDisk disk_{parent_.path()};
  std::unique_ptr<Recorder> recorder_ = recorder();
};

TEST_F(FailingDisk, WhatASyncDidNotTakeIsWrittenAgain) {
  play(*recorder_, 100);
  recorder_->work(1000);
  const std::uint64_t safe = recorder_->counters().inputs_safe;
  EXPECT_GT(safe, 0u);

  const std::uint64_t syncs = recorder_->counters().syncs;
  disk_.set({.fault = test::DiskFault::kInputOutput, .calls = test::kSyncCall});
  play(*recorder_, 100);
  std::this_thread::sleep_for(std::chrono::milliseconds(600));  // a sync is due
  recorder_->work(20);
  EXPECT_EQ(recorder_->disk(), Recorder::Disk::kFull);
  EXPECT_EQ(recorder_->counters().inputs_safe, safe);
  EXPECT_EQ(recorder_->counters().syncs, syncs);
  EXPECT_GT(recorder_->counters().syncs_failed, 0u);
  EXPECT_GT(recorder_->counters().write_failures, 0u);
  EXPECT_GT(recorder_->counters().images_dropped_disk, 0u);
  // As if the system had dropped the pages that it could not write.
  const auto log = MissionPaths(folder_).log();
  const auto size = std::filesystem::file_size(log);
  std::filesystem::resize_file(log, size / 2);
  std::filesystem::resize_file(log, size);

  disk_.clear();
  play(*recorder_, 100);
  EXPECT_TRUE(recorder_->close(30).log_whole);
  EXPECT_EQ(recorder_->counters().inputs_safe, 300u);
  expectInputs(300u);
}

TEST_F(FailingDisk, ASlowOneDelaysNoProducerAndLosesNothing) {
  // Each sync, of the log and of each image.
  disk_.set({.fault = test::DiskFault::kStall, .calls = test::kSyncCall, .stall_ms = 100});
  std::atomic<bool> ended{false};
  std::thread writer([&] {
    while (!ended) {
      recorder_->work(50);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const auto start = std::chrono::steady_clock::now();
  for (; next_ < 300; ++next_) {
    EXPECT_TRUE(player_.offer(*recorder_, next_));
    std::this_thread::sleep_until(start + std::chrono::milliseconds(10) * next_);
  }
  ended = true;
  writer.join();
  EXPECT_TRUE(recorder_->close(30).log_whole);
  const Recorder::Counters c = recorder_->counters();
  EXPECT_EQ(c.images, 12u);
  EXPECT_GE(c.worst_sync_ns, 100'000'000);
  EXPECT_GE(c.worst_unsafe_ns, c.worst_sync_ns);
  EXPECT_GE(c.syncs, 4u);
  EXPECT_THAT(dive_.check(folder_).wrong, ::testing::IsEmpty());
}

// A log on a disk that refuses to be read.

const auto kSaysWhere =
    ::testing::AllOf(HasSubstr("cannot be read beyond byte "), HasSubstr("(Input/output error)"));

class UnreadableLog : public ::testing::Test {
 protected:
  static constexpr int kInputs = 2000, kRaw = 400;

  void SetUp() override {
    SensorLogWriter log(path_);
    for (int i = 0; i < kInputs; ++i) log.write(i, DepthSample{i, 1.0 + i});
    LogEventWriter raw(path_);
    for (int i = 0; i < kRaw; ++i) raw.write(i, "RAW_DVL", std::vector<std::uint8_t>(1000, 7));
  }
  // Reads of the log fail behind the first `after`.
  void spoilReading(std::uint64_t after) {
    disk_.set({.fault = DiskFault::kInputOutput,
               .path = "sensors.lcmlog",
               .calls = test::kReadCall,
               .after = after});
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = MissionPaths(folder_.path()).log();
  BadDisk disk_{folder_.path()};
};

TEST_F(UnreadableLog, IsNeitherDamagedNorAtItsEnd) {
  for (const std::uint64_t after : {0, 1, 3}) {
    LogEventReader events(path_);
    LogEvent event;
    spoilReading(after);
    std::int64_t read = 0;
    while (events.next(event)) ++read;
    EXPECT_TRUE(events.readFailed());
    EXPECT_THAT(events.failure(), kSaysWhere);
    EXPECT_EQ(events.damagedStretches(), 0u);
    EXPECT_LT(read, kInputs + kRaw);
    EXPECT_GT(read, after == 0 ? -1 : 100);
    EXPECT_THAT(refusal([&] { events.throwIfReadFailed(); }), kSaysWhere);
    disk_.clear();
    events.rewind();
    for (read = 0; events.next(event); ++read) EXPECT_EQ(event.number, read);
    EXPECT_EQ(read, kInputs + kRaw);
    EXPECT_FALSE(events.readFailed());
    EXPECT_EQ(events.failure(), "");
    events.throwIfReadFailed();
  }
}

TEST_F(UnreadableLog, IsNotCutByTheRecorderWhichContinuesWhenItCanBeRead) {
  const std::string before = readText(path_);
  for (const std::uint64_t after : {0, 1, 2}) {
    JournalFile journal;
    spoilReading(after);
    EXPECT_FALSE(journal.open(path_, 0, 0));
    EXPECT_FALSE(journal.isOpen());
    EXPECT_THAT(journal.failure(), kSaysWhere);
    disk_.clear();
    EXPECT_TRUE(readText(path_) == before);
    EXPECT_TRUE(journal.open(path_, 0, 0));
    EXPECT_EQ(journal.wholeAtStart(), before.size());
    EXPECT_EQ(journal.cutAtStart(), 0u);
  }
  EXPECT_TRUE(readText(path_) == before);
}

TEST_F(UnreadableLog, OfWhichNotOneEventCanBeReadIsNotTakenForNoLog) {
  test::writeText(path_, std::string(100, '\0'));
  JournalFile journal;
  disk_.set({.fault = DiskFault::kInputOutput, .calls = test::kReadCall, .after = 2});
  EXPECT_FALSE(journal.open(path_, 0, 0));
  EXPECT_THAT(journal.failure(), HasSubstr("cannot be read (Input/output error)"));
  disk_.clear();
  EXPECT_EQ(std::filesystem::file_size(path_), 100u);
}

TEST_F(UnreadableLog, IsReportedByEveryReaderAndCutByNoWriter) {
  const std::string before = readText(path_);
  std::uint64_t damaged = 0;
  spoilReading(2);
  EXPECT_THAT(refusal([&] { (void)readOnboardInputs(folder_.path(), damaged); }), kSaysWhere);
  disk_.clear();
  spoilReading(2);
  disk_.clear();
  spoilReading(2);
  EXPECT_THAT(refusal([&] { (void)test::readGaps(folder_.path()); }), kSaysWhere);
  disk_.clear();
  SensorLogReader samples(folder_.path());
  while (damaged < kInputs && samples.next()) ++damaged;
  spoilReading(0);
  EXPECT_THAT(refusal([&] {
                while (samples.next()) continue;
              }),
              kSaysWhere);
  disk_.clear();
  spoilReading(2);
  EXPECT_THAT(refusal([&] { LogEventWriter writer(path_); }), kSaysWhere);
  disk_.clear();
  EXPECT_TRUE(readText(path_) == before);
}

TEST_F(UnreadableLog, IsReadOnFromWhereItFailedWhenTheDiskAnswersAgain) {
  LogInputReader inputs(folder_.path());
  LogInputReader::Entry entry;
  spoilReading(1);
  LogInputReader::Step step;
  while ((step = inputs.next(entry)) == LogInputReader::Step::kInput) continue;
  EXPECT_EQ(step, LogInputReader::Step::kUnreadable);
  EXPECT_THAT(inputs.failure(), kSaysWhere);
  EXPECT_THAT(refusal([&] { (void)inputs.seekBehindMark(1, 0); }), kSaysWhere);
  const std::uint64_t there = inputs.position();
  disk_.clear();
  std::uint64_t next = there;
  while ((step = inputs.next(entry)) == LogInputReader::Step::kInput) {
    EXPECT_EQ(entry.position, next);
    EXPECT_EQ(entry.input.arrival_utc_ns, static_cast<std::int64_t>(next++));
  }
  EXPECT_EQ(step, LogInputReader::Step::kEnd);
  EXPECT_EQ(next, static_cast<std::uint64_t>(kInputs));
  EXPECT_LT(there, next);
  EXPECT_EQ(inputs.damaged(), 0u);
  EXPECT_EQ(inputs.failure(), "");
}

}  // namespace
}  // namespace fathom::io

namespace fathom::test {
namespace {

using ::testing::HasSubstr;

// The bad disk itself, around programs of the system.

class BadDiskTest : public ::testing::Test {
 protected:
  // "dd" of 64 KiB in pieces of 4 KiB, synced, under the bad disk.
  Outcome copy(const std::filesystem::path& from, const std::filesystem::path& to) {
    return run("dd bs=4096 count=16 conv=fsync if=" + from.string() + " of=" + to.string());
  }
  Outcome run(const std::string& command) {
    std::string line = "env";
    for (const std::string& variable : disk_.environment()) line += " " + variable;
    return runCommand(line + " LC_ALL=C " + command);
  }

  TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_.path() / "disk", file_ = folder_ / "file";
  BadDisk disk_{(std::filesystem::create_directory(folder_), folder_)};
};

TEST_F(BadDiskTest, TouchesNothingUntilItIsSetAndNothingElsewhere) {
  EXPECT_EQ(copy("/dev/zero", file_).exit_code, 0);
  EXPECT_EQ(std::filesystem::file_size(file_), 65536u);
  const auto rule = disk_.set({.fault = DiskFault::kInputOutput});
  EXPECT_EQ(copy("/dev/zero", parent_.path() / "other").exit_code, 0);
  EXPECT_EQ(disk_.hits(rule), 0u);
}

TEST_F(BadDiskTest, SpoilsTheCallsOfAChildAsLongAsItIsSet) {
  struct Case {
    BadDisk::Order order;
    const char* error;
    std::uint64_t hits, bytes;
  };
  for (const Case& c : {
           Case{{.fault = DiskFault::kInputOutput, .calls = kSyncCall}, "Input/output error", 1, 65536},
           Case{{.fault = DiskFault::kNoSpace, .calls = kWriteCall, .after = 3, .times = 1},
                "No space left on device",
                1,
                3 * 4096},
           Case{{.fault = DiskFault::kShortWrite}, "No space left on device", 2, 2048},
           Case{{.fault = DiskFault::kReadOnly}, "Read-only file system", 1, 0},
           Case{{.fault = DiskFault::kInputOutput, .path = "another"}, "", 0, 65536},
           Case{{.fault = DiskFault::kStall, .stall_ms = 1}, "", 0, 65536},
       }) {
    std::filesystem::remove(file_);
    const auto rule = disk_.set(c.order);
    const Outcome outcome = copy("/dev/zero", file_);
    EXPECT_EQ(outcome.exit_code, *c.error == 0 ? 0 : 1) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(c.error));
    if (c.order.fault == DiskFault::kStall)
      EXPECT_GE(disk_.hits(rule), 18u);
    else
      EXPECT_EQ(disk_.hits(rule), c.hits) << outcome.err;
    disk_.clear();
    EXPECT_EQ(std::filesystem::exists(file_) ? std::filesystem::file_size(file_) : 0, c.bytes);
    std::filesystem::remove(file_);
    EXPECT_EQ(copy("/dev/zero", file_).exit_code, 0);
  }
}

TEST_F(BadDiskTest, SpoilsReadingRenamingAndRemoving) {
  writeText(file_, "text");
  const auto to = (folder_ / "to").string();
  disk_.set({.fault = DiskFault::kInputOutput, .calls = kReadCall});
  EXPECT_THAT(run("dd status=none if=" + file_.string()).err, HasSubstr("Input/output error"));
  disk_.clear();
  EXPECT_EQ(run("dd status=none if=" + file_.string()).out, "text");
  disk_.set({.fault = DiskFault::kReadOnly});
  EXPECT_THAT(run("mv " + file_.string() + " " + to).err, HasSubstr("Read-only file system"));
  EXPECT_THAT(run("rm " + file_.string()).err, HasSubstr("Read-only file system"));
  EXPECT_THAT(run("mkdir " + to).err, HasSubstr("Read-only file system"));
  EXPECT_EQ(run("dd status=none if=" + file_.string()).out, "text");
}

TEST_F(BadDiskTest, SpoilsAProgramOfOursWhileItRuns) {
  const auto rule = disk_.set({.fault = DiskFault::kReadOnly, .path = "sensors.lcmlog", .for_ms = 300});
  const Outcome outcome =
      run(FATHOM_BIN_DIR "/dive_recorder " + (folder_ / "dive").string() + " --seconds 0.6 --speed 2");
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_GT(disk_.hits(rule), 0u);
  const SyntheticDive::Found found = SyntheticDive({}).check(folder_ / "dive");
  EXPECT_THAT(found.wrong, ::testing::IsEmpty());
  EXPECT_GT(found.inputs, 50u);
  EXPECT_EQ(found.skipped, 0u);
  EXPECT_GT(found.images_lost, 0u);
}

TEST_F(BadDiskTest, EndsByItselfWhenItsTimeIsOver) {
  disk_.set({.fault = DiskFault::kReadOnly, .for_ms = 1});
  ::usleep(2000);
  EXPECT_EQ(copy("/dev/zero", file_).exit_code, 0);
}

}  // namespace
}  // namespace fathom::test
