// A log on a disk that refuses to be read.
#include <gmock/gmock.h>

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_inputs.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "firmware_if/recorder/journal_file.hpp"
#include "tests/support/bad_disk.hpp"
#include "tests/support/recording_gaps.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

using test::BadDisk;
using test::DiskFault;
using test::readText;
using test::refusal;
using ::testing::AllOf;
using ::testing::HasSubstr;

const auto kSaysWhere = AllOf(HasSubstr("cannot be read beyond byte "), HasSubstr("(Input/output error)"));

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
