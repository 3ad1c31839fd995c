#include <gtest/gtest.h>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kConfiguration = 11, kMission = 22;

CheckpointHead headOf(std::uint64_t number) {
  return {kConfiguration, kMission, number, 1000 * number, static_cast<std::int64_t>(number) * 1'000'000'000};
}

std::vector<std::uint8_t> stateOf(std::uint64_t number) {
  std::vector<std::uint8_t> bytes(20000);
  rt::StateWriter writer(bytes);
  writer.section(rt::stateTag("TEST"), 1, [&] {
    for (std::uint64_t i = 0; i < 1000; ++i) writer(i * number);
  });
  bytes.resize(writer.size());
  return bytes;
}

class Checkpoints : public ::testing::Test {
 protected:
  const test::TemporaryFolder folder;
  CheckpointFiles files{folder.path() / "state"};
  std::vector<std::string> said;

  std::optional<CheckpointFiles::Found> newest() {
    said.clear();
    return files.readNewest(kConfiguration, kMission, said);
  }
};

TEST_F(Checkpoints, NoneIsThereAtFirst) {
  EXPECT_FALSE(newest());
  EXPECT_TRUE(said.empty());
}

TEST_F(Checkpoints, TheNewestOfTwoFilesIsRead) {
  for (std::uint64_t number = 1; number <= 5; ++number) {
    ASSERT_TRUE(files.write(headOf(number), stateOf(number))) << files.error();
    const auto found = newest();
    ASSERT_TRUE(found);
    EXPECT_EQ(found->head, headOf(number));
    EXPECT_EQ(found->state, stateOf(number));
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(files.folder()), fs::directory_iterator()), 2);
  files.remove();
  EXPECT_FALSE(newest());
}

TEST_F(Checkpoints, ADamagedOneIsPassedOverForTheOneBeforeWithAReason) {
  ASSERT_TRUE(files.write(headOf(1), stateOf(1)));
  ASSERT_TRUE(files.write(headOf(2), stateOf(2)));
  const fs::path second = files.file(2);
  const std::vector<std::uint8_t> whole = test::readBytes(second);
  const auto passedOver = [&](const std::vector<std::uint8_t>& bytes) {
    test::writeBytes(second, bytes);
    const auto found = newest();
    return found && found->head.number == 1 && said.size() == 1;
  };
  for (std::size_t at = 0; at < whole.size(); at += at < 100 ? 1 : 53) {
    std::vector<std::uint8_t> damaged = whole;
    damaged[at] ^= 4;
    // The last word of the head is not used, but its checksum covers it.
    EXPECT_TRUE(passedOver(damaged)) << at;
    damaged = {whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(at)};
    EXPECT_TRUE(passedOver(damaged)) << at;
  }
  std::vector<std::uint8_t> longer = whole;
  longer.push_back(0);
  EXPECT_TRUE(passedOver(longer));
  EXPECT_NE(said[0].find("passed over, it was not written to its end"), std::string::npos) << said[0];
}

TEST_F(Checkpoints, AnotherMissionsOrConfigurationsIsRefusedWithTheReason) {
  ASSERT_TRUE(files.write(headOf(1), stateOf(1)));
  EXPECT_FALSE(files.readNewest(kConfiguration, kMission + 1, said));
  EXPECT_FALSE(files.readNewest(kConfiguration + 1, kMission, said));
  ASSERT_EQ(said.size(), 2u);
  EXPECT_NE(said[0].find("another mission"), std::string::npos);
  EXPECT_NE(said[1].find("another program or configuration"), std::string::npos);
}

TEST_F(Checkpoints, AWriteThatFailsLeavesWhatWasThere) {
  ASSERT_TRUE(files.write(headOf(1), stateOf(1)));
  fs::create_directory(files.folder() / "checkpoint.tmp");  // where the temporary file should be
  EXPECT_FALSE(files.write(headOf(2), stateOf(2)));
  EXPECT_NE(files.error(), "");
  ASSERT_TRUE(newest());
  EXPECT_EQ(newest()->head.number, 1u);
}

// A program that comes back: it knows of the files only what they say.
class CheckpointsAgain : public Checkpoints {
 protected:
  void SetUp() override {
    ASSERT_TRUE(files.write(headOf(1), stateOf(1)));
    ASSERT_TRUE(files.write(headOf(2), stateOf(2)));
  }
  void damage(std::uint64_t number) const {
    const fs::path path = again.file(number);
    std::vector<std::uint8_t> bytes = test::readBytes(path);
    bytes.back() ^= 1;
    test::writeBytes(path, bytes);
  }
  [[nodiscard]] std::vector<std::uint64_t> numbers() {
    std::vector<std::uint64_t> all;
    for (const CheckpointHead& head : again.usable(kConfiguration, kMission, said))
      all.push_back(head.number);
    return all;
  }

  CheckpointFiles again{folder.path() / "state"};
};
using Numbers = std::vector<std::uint64_t>;

TEST_F(CheckpointsAgain, TriesTheNewestThenTheOneBeforeAndNothingIsRemoved) {
  damage(2);
  EXPECT_EQ(numbers(), (Numbers{2, 1}));
  EXPECT_FALSE(again.read(2, said));
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("its state is damaged"), std::string::npos);
  const auto before = again.read(1, said);
  ASSERT_TRUE(before);
  EXPECT_EQ(before->state, stateOf(1));
  EXPECT_EQ(numbers(), (Numbers{2, 1}));
  EXPECT_FALSE(again.read(3, said));
}

TEST_F(CheckpointsAgain, NeverWritesOverTheOneThatItReadWhateverItsNumber) {
  damage(2);
  ASSERT_TRUE(again.read(1, said));
  ASSERT_TRUE(again.write(headOf(3), stateOf(3)));
  EXPECT_EQ(numbers(), (Numbers{3, 1}));
  ASSERT_TRUE(again.write(headOf(5), stateOf(5)));
  EXPECT_EQ(numbers(), (Numbers{5, 3}));
}

TEST_F(CheckpointsAgain, BeforeItReadAnythingTheOlderOrAnUnusableOneIsReplaced) {
  ASSERT_TRUE(again.write(headOf(4), stateOf(4)));
  EXPECT_EQ(numbers(), (Numbers{4, 2}));

  CheckpointFiles other(folder.path() / "state");
  fs::resize_file(other.file(4), 1000);
  ASSERT_TRUE(other.write(headOf(6), stateOf(6)));
  EXPECT_EQ(numbers(), (Numbers{6, 2}));

  CheckpointFiles configured(folder.path() / "state");
  CheckpointHead head = headOf(7);
  head.configuration = kConfiguration + 1;
  ASSERT_TRUE(configured.write(head, stateOf(7)));
  head.number = 8;
  ASSERT_TRUE(configured.write(head, stateOf(8)));
  EXPECT_EQ(numbers(), Numbers{});
}

TEST_F(CheckpointsAgain, TheStartOfAStateIsReadAloneWhateverItsEndIs) {
  damage(2);
  constexpr std::size_t kStart = 500;
  const auto start = again.readStart(2, kStart, said);
  ASSERT_TRUE(start);
  EXPECT_EQ(start->head, headOf(2));
  const std::vector<std::uint8_t> whole = stateOf(2);
  EXPECT_EQ(start->state, std::vector<std::uint8_t>(whole.begin(), whole.begin() + kStart));
  EXPECT_EQ(again.readStart(1, SIZE_MAX, said)->state, stateOf(1));
  EXPECT_FALSE(again.readStart(3, kStart, said));
  EXPECT_TRUE(said.empty());
}

TEST_F(CheckpointsAgain, AStateIsReadIntoRoomThatIsThere) {
  std::vector<std::uint8_t> room(stateOf(2).size() + 100);
  const auto state = again.read(2, room, said);
  ASSERT_TRUE(state);
  EXPECT_EQ(state->data(), room.data());
  EXPECT_EQ(std::vector<std::uint8_t>(state->begin(), state->end()), stateOf(2));
  EXPECT_FALSE(again.read(2, std::span(room).first(100), said));
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("has no room in the 100 bytes for one"), std::string::npos) << said[0];
  damage(2);
  EXPECT_FALSE(again.read(2, room, said));
}

// A restart has no more memory than a running dive.
TEST_F(Checkpoints, ALargeStateIsReadWithoutMemoryOfItsSizeBesideTheRoom) {
  constexpr std::size_t kLarge = std::size_t{64} << 20, kBeside = std::size_t{1} << 20;
  std::vector<std::uint8_t> room(kLarge, 1);
  rt::StateWriter writer(room);
  writer.section(rt::stateTag("LARG"), 1, [&] {
    for (std::uint64_t i = 0; i < kLarge / sizeof i - 100; ++i) writer(i);
  });
  ASSERT_TRUE(files.write(headOf(1), writer.written()));
  rt::ProcessMemory memory;
  rt::ProcessFigures before, after;
  ASSERT_TRUE(memory.read(before));
  CheckpointFiles again{folder.path() / "state"};
  ASSERT_TRUE(again.read(1, room, said));
  ASSERT_TRUE(memory.read(after));
  EXPECT_LT(after.highest_resident, before.highest_resident + kBeside);
}

TEST_F(CheckpointsAgain, ANumberThatAPassedOverFileHasIsKnown) {
  CheckpointHead head = headOf(9);
  head.mission = kMission + 1;
  ASSERT_TRUE(again.write(head, stateOf(9)));
  fs::resize_file(again.file(9), 1000);
  EXPECT_EQ(numbers(), Numbers{2});
  EXPECT_EQ(again.newestNumber(), 9u);
  again.remove();
  EXPECT_EQ(again.newestNumber(), 0u);
}

TEST_F(Checkpoints, TheWriterTakesOneAtATimeAndCountsWhatIsLate) {
  CheckpointWriter writer(files, 20000, {folder.path() / "not-there"});
  EXPECT_FALSE(writer.work());
  for (std::uint64_t number = 1; number <= 3; ++number) {
    const std::span<std::uint8_t> buffer = writer.begin();
    const std::vector<std::uint8_t> state = stateOf(number);
    ASSERT_GE(buffer.size(), state.size());
    std::copy(state.begin(), state.end(), buffer.begin());
    writer.submit(headOf(number), state.size());
    EXPECT_TRUE(writer.begin().empty());
    EXPECT_TRUE(writer.work());
    ASSERT_TRUE(newest());
    EXPECT_EQ(newest()->state, state);
  }
  writer.giveUp();
  EXPECT_EQ(writer.counters().written, 3u);
  EXPECT_EQ(writer.oldest(), 2u);
  EXPECT_EQ(writer.counters().late, 3u);
  EXPECT_EQ(writer.counters().too_large, 1u);
  EXPECT_EQ(writer.counters().utc_ns, headOf(3).utc_ns);
  fs::create_directory(files.folder() / "checkpoint.tmp");
  writer.submit(headOf(4), 10);
  EXPECT_FALSE(writer.work());
  EXPECT_EQ(writer.counters().failed, 1u);
  EXPECT_FALSE(writer.begin().empty());
}

TEST(CheckpointHash, DependsOnTheOrderOfItsParts) {
  EXPECT_NE(checkpointHash("b", checkpointHash("a")), checkpointHash("a", checkpointHash("b")));
  EXPECT_EQ(checkpointHash("b", checkpointHash("a")), checkpointHash("ab"));
}

}  // namespace
}  // namespace fathom::onboard
