#include <gtest/gtest.h>

#include <cstring>
#include <iterator>

#include "realtime/kernel/state_archive.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/checkpoint/checkpoint_writer.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

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
  const std::vector<std::uint8_t> whole = test::readBytes(files.file(2));
  const auto passedOver = [&](const std::vector<std::uint8_t>& bytes) {
    test::writeBytes(files.file(2), bytes);
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
