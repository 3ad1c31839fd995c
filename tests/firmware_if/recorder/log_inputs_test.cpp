#include "firmware_if/mission/log/onboard_input.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/mission.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using Step = LogInputReader::Step;
using ::testing::ElementsAre;

class LogInputs : public ::testing::Test {
 protected:
  // The bytes of an event, numbered on.
  std::string event(const LogMessage& message) {
    std::vector<std::uint8_t> bytes;
    appendLogEvent(bytes, number_++, 0, message.channel, message.data);
    return {bytes.begin(), bytes.end()};
  }
  std::string input(std::int64_t arrival, const OnboardInput::What& what = Tick{}) {
    return event(encodeInput({arrival, what}));
  }
  std::string gap(std::uint64_t count, RecordingGap::Kind kind = RecordingGap::Kind::kInputs,
                  std::string_view what = "") {
    return event(encodeGap({0, kind, count, std::string(what)}));
  }
  static Mark mark(std::uint64_t number) { return {Mark::Kind::kCheckpoint, number}; }
  void add(const std::string& bytes) { std::ofstream(path_, std::ios::binary | std::ios::app) << bytes; }
  // What the reader gives up to the end: "7" an input that arrived at 7, "d" a decision, "-3" three missing,
  // each with "@" and its position.
  static std::vector<std::string> rest(LogInputReader& reader) {
    std::vector<std::string> steps;
    LogInputReader::Entry entry;
    for (;;) {
      const Step step = reader.next(entry);
      if (step == Step::kEnd) return steps;
      std::string text = step == Step::kDecision  ? "d"
                         : step == Step::kMissing ? "-" + std::to_string(entry.missing)
                         : step == Step::kInput   ? std::to_string(entry.input.arrival_utc_ns)
                                                  : "unreadable";
      steps.push_back(text + "@" + std::to_string(entry.position));
    }
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = MissionPaths(folder_.path()).log();
  std::int64_t number_ = 0;
};

TEST_F(LogInputs, HavePositionsWithThoseThatAreMissingAndWithoutDecisions) {
  add(input(10) + input(11, Decision{}) + input(12, mark(1)) + event({"RAW_DVL", encodeRaw(0, {})}));
  add(gap(5) + input(13) + gap(2, RecordingGap::Kind::kInputs, kGapOfDecisions) +
      gap(4, RecordingGap::Kind::kInputs, kGapOfMapper));
  add(gap(1, RecordingGap::Kind::kImage, "a.tif") + gap(3, RecordingGap::Kind::kRaw) + input(14));
  LogInputReader reader(folder_.path());
  EXPECT_THAT(rest(reader), ElementsAre("10@0", "d@1", "12@1", "-5@2", "13@7", "14@8"));
  EXPECT_EQ(reader.position(), 9u);
  EXPECT_EQ(reader.damaged(), 0u);
}

TEST_F(LogInputs, ADamagedOneIsMissingAndKeepsItsPlace) {
  const std::string good = input(1);
  std::string bad = input(2);
  bad.back() ^= 1;
  add(good + bad + input(3));
  LogInputReader reader(folder_.path());
  EXPECT_THAT(rest(reader), ElementsAre("1@0", "-1@1", "3@2"));
  EXPECT_EQ(reader.damaged(), 1u);
  add("rubbish" + input(4));
  EXPECT_THAT(rest(reader), ElementsAre("4@3"));
  EXPECT_EQ(reader.damaged(), 2u);
}

TEST_F(LogInputs, ComeAsTheLogGrowsByteByByteFromNothingOn) {
  LogInputReader reader(folder_.path());
  EXPECT_THAT(rest(reader), ElementsAre());
  std::string all;
  std::vector<std::size_t> ends;
  for (int i = 0; i < 5; ++i) {
    all += input(i) + (i % 2 == 0 ? event({"RAW_DVL", encodeRaw(0, std::vector<std::uint8_t>(50, 1))}) : "");
    ends.push_back(all.size());
  }
  std::size_t given = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    add(all.substr(i, 1));
    given += rest(reader).size();
    const auto whole = static_cast<std::size_t>(
        std::count_if(ends.begin(), ends.end(), [&](std::size_t end) { return end <= i + 1; }));
    EXPECT_GE(given, whole) << i;
    EXPECT_LE(given, whole + 1) << i;
  }
  EXPECT_EQ(reader.position(), 5u);
  EXPECT_EQ(reader.damaged(), 0u);
}

TEST_F(LogInputs, BytesThatTheDiskHadNotYetAreReadAgain) {
  const std::string a = input(1), b = input(2), c = input(3), d = input(4);
  // As after a sync that failed: the system gives zeros for what it has dropped.
  add(a + std::string(b.size() + c.size(), '\0'));
  LogInputReader reader(folder_.path());
  EXPECT_THAT(rest(reader), ElementsAre("1@0"));
  EXPECT_EQ(reader.damaged(), 0u);
  std::string half = b;
  std::fill(half.end() - 8, half.end(), '\0');
  test::writeText(path_, a + half + std::string(c.size(), '\0') + d);
  LogInputReader ahead(folder_.path());
  LogInputReader::Entry entry;
  EXPECT_EQ(ahead.next(entry), Step::kInput);  // with what follows, as it is now
  test::writeText(path_, a + b + c + d);
  EXPECT_THAT(rest(ahead), ElementsAre("2@1", "3@2", "4@3"));
  EXPECT_EQ(ahead.damaged(), 0u);
  EXPECT_THAT(rest(reader), ElementsAre("2@1", "3@2", "4@3"));
  EXPECT_EQ(reader.damaged(), 0u);
}

TEST_F(LogInputs, AreFoundBehindAMarkHoweverLongTheLogIs) {
  LogInputReader reader(folder_.path());
  EXPECT_FALSE(reader.seekBehindMark(1, 1));
  add(input(0, mark(1)));
  for (int i = 1; i <= 20; ++i)  // 20 MiB between the marks
    add(input(i) + event({"RAW_DVL", encodeRaw(i, std::vector<std::uint8_t>(1 << 20, 1))}));
  add(input(21, mark(2)) + input(22) + input(23, Mark{Mark::Kind::kRestart, 1}));
  EXPECT_TRUE(reader.seekBehindMark(2, 22));
  EXPECT_THAT(rest(reader), ElementsAre("22@22", "23@23"));
  add(input(24));
  EXPECT_THAT(rest(reader), ElementsAre("24@24"));
  EXPECT_FALSE(reader.seekBehindMark(7, 0));
  EXPECT_EQ(reader.position(), 25u);  // where it was
  EXPECT_FALSE(reader.seekBehindMark(1, 1, 10));
  EXPECT_TRUE(reader.seekBehindMark(1, 1));
  EXPECT_EQ(rest(reader).size(), 24u);
  EXPECT_EQ(reader.position(), 25u);
  EXPECT_EQ(reader.damaged(), 0u);
  LogInputReader whole(folder_.path());
  EXPECT_EQ(rest(whole).size(), 25u);
}

}  // namespace
}  // namespace fathom::io
