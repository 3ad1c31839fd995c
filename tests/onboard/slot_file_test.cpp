#include "realtime/onboard/slots/slot_file.hpp"

#include <gtest/gtest.h>

#include <sys/stat.h>

#include <memory>
#include <random>

#include "tests/support/full_disk.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

TEST(SlotFile, GivesBackWhatWasWrittenAndLeavesNoFileBehind) {
  const test::TemporaryFolder folder;
  SlotFile file(folder.path(), 5, 1000);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  std::vector<std::uint8_t> data(1000, 7), back(1000);
  EXPECT_TRUE(file.write(4, data));
  EXPECT_TRUE(file.write(0, std::vector<std::uint8_t>(10, 9)));
  EXPECT_TRUE(file.read(4, back));
  EXPECT_EQ(back, data);
  EXPECT_TRUE(file.read(0, back));
  EXPECT_EQ(back[9], 9);
  EXPECT_EQ(back[10], 0);
  EXPECT_TRUE(file.read(2, back));
  EXPECT_EQ(back, std::vector<std::uint8_t>(1000, 0));
}

TEST(SlotFile, RefusesSlotsThatDoNotExistAndBlocksThatAreTooLarge) {
  const test::TemporaryFolder folder;
  SlotFile file(folder.path(), 5, 1000);
  std::vector<std::uint8_t> data(1001);
  EXPECT_FALSE(file.write(0, data));
  EXPECT_FALSE(file.read(0, data));
  data.resize(10);
  EXPECT_FALSE(file.write(5, data));
  EXPECT_FALSE(file.read(5, data));
}

TEST(SlotFile, ADiskWithoutRoomOrAFolderThatIsNotThereIsSaidAtOnce) {
  const test::TemporaryFolder folder;
  constexpr std::size_t kTooMuch = std::size_t{1} << 50;  // [bytes]
  EXPECT_THROW(SlotFile(folder.path(), 1, kTooMuch), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_THROW(SlotFile(folder.path() / "absent", 1, 10), InputError);
}

TEST(SlotFile, ANamedOneOutlivesItsProgram) {
  const test::TemporaryFolder folder;
  const auto name = folder.path() / "meshes.slots";
  const std::vector<std::uint8_t> data(100, 7);
  std::vector<std::uint8_t> back(100);
  {
    SlotFile file(SlotFile::Named{name, true}, 5, 1000);
    EXPECT_FALSE(file.kept());
    EXPECT_TRUE(file.write(3, data));
    EXPECT_TRUE(file.sync());
  }
  {
    SlotFile file(SlotFile::Named{name, true}, 5, 1000);
    EXPECT_TRUE(file.kept());
    EXPECT_TRUE(file.read(3, back));
    EXPECT_EQ(back, data);
  }
  SlotFile fresh(SlotFile::Named{name, false}, 5, 1000);
  EXPECT_FALSE(fresh.kept());
  EXPECT_TRUE(fresh.read(3, back));
  EXPECT_EQ(back, std::vector<std::uint8_t>(100, 0));
}

TEST(SlotFile, ANamedOneOfAnotherSizeBeginsWithZeros) {
  const test::TemporaryFolder folder;
  const auto name = folder.path() / "meshes.slots";
  std::vector<std::uint8_t> block(1000, 7);
  {
    SlotFile file(SlotFile::Named{name, false}, 5, 1000);
    EXPECT_TRUE(file.write(0, block));
  }
  SlotFile larger(SlotFile::Named{name, true}, 6, 1000);
  EXPECT_FALSE(larger.kept());
  EXPECT_TRUE(larger.read(0, block));
  EXPECT_EQ(block, std::vector<std::uint8_t>(1000, 0));
  EXPECT_THROW(SlotFile(SlotFile::Named{folder.path(), true}, 5, 1000), InputError);
}

using Block = std::vector<std::uint8_t>;

// A named slot file with marks; kill() is what kill -9 leaves: nothing is synced, nothing is closed in order.
class MarkedSlots : public ::testing::Test {
 protected:
  static constexpr std::size_t kSlots = 20, kBytes = 1000;
  const test::TemporaryFolder folder;
  const std::filesystem::path name = folder.path() / "meshes.slots", journal = name.string() + ".undo";
  std::unique_ptr<SlotFile> file = std::make_unique<SlotFile>(SlotFile::Named{name, false}, kSlots, kBytes);

  void kill() {
    file.reset();
    file = std::make_unique<SlotFile>(SlotFile::Named{name, true}, kSlots, kBytes);
    ASSERT_TRUE(file->kept());
  }
  [[nodiscard]] static Block blockOf(std::uint8_t value, std::size_t bytes = kBytes) {
    return Block(bytes, value);
  }
  [[nodiscard]] static std::vector<Block> contentOf(SlotFile& slots) {
    std::vector<Block> all(slots.slots(), Block(kBytes));
    for (std::size_t k = 0; k < all.size(); ++k) EXPECT_TRUE(slots.read(k, all[k]));
    return all;
  }
  [[nodiscard]] std::vector<Block> content() { return contentOf(*file); }
  static void writeSome(SlotFile& slots, std::mt19937& random) {
    for (int i = 0; i < 15; ++i)
      ASSERT_TRUE(
          slots.write(random() % kSlots, blockOf(static_cast<std::uint8_t>(random()), random() % kBytes)));
  }
};

TEST_F(MarkedSlots, GoBackToAnyMarkAndOnFromThereWithAndWithoutAName) {
  std::mt19937 random(1);
  SlotFile nameless(folder.path(), kSlots, kBytes);
  for (SlotFile* slots : {file.get(), &nameless}) {
    std::vector<std::vector<Block>> at;  // by mark
    at.push_back(contentOf(*slots));
    for (std::uint64_t number = 1; number <= 6; ++number) {
      writeSome(*slots, random);
      at.push_back(contentOf(*slots));
      slots->mark(number);
    }
    for (const std::uint64_t number : {6U, 4U, 4U, 2U}) {
      writeSome(*slots, random);
      ASSERT_TRUE(slots->rollBack(number));
      EXPECT_EQ(contentOf(*slots), at[number]);
    }
    EXPECT_FALSE(slots->rollBack(4));  // which is later than 2
    writeSome(*slots, random);
    at[3] = contentOf(*slots);
    slots->mark(3);
    writeSome(*slots, random);
    for (const std::uint64_t number : {3U, 1U, 0U}) {
      ASSERT_TRUE(slots->rollBack(number));
      EXPECT_EQ(contentOf(*slots), at[number]);
    }
    EXPECT_FALSE(slots->rollBack(1));
  }
}

TEST_F(MarkedSlots, GoBackAfterTheProgramWasKilled) {
  std::mt19937 random(2);
  writeSome(*file, random);
  const std::vector<Block> one = content();
  file->mark(1);
  writeSome(*file, random);
  const std::vector<Block> two = content();
  file->mark(2);
  writeSome(*file, random);
  kill();
  writeSome(*file, random);
  ASSERT_TRUE(file->rollBack(2));
  EXPECT_EQ(content(), two);
  writeSome(*file, random);
  kill();
  ASSERT_TRUE(file->rollBack(1));
  EXPECT_EQ(content(), one);
  kill();
  ASSERT_TRUE(file->rollBack(0));
  EXPECT_EQ(content(), std::vector<Block>(kSlots, blockOf(0)));
  // A new one has no marks.
  file->mark(5);
  file = std::make_unique<SlotFile>(SlotFile::Named{name, false}, kSlots, kBytes);
  EXPECT_FALSE(file->rollBack(5));
}

TEST_F(MarkedSlots, ForgetMarksAndGiveTheirRoomBack) {
  std::mt19937 random(3);
  std::vector<Block> four;
  for (std::uint64_t number = 1; number <= 5; ++number) {
    for (std::size_t slot = 0; slot < kSlots; ++slot)
      ASSERT_TRUE(file->write(slot, blockOf(static_cast<std::uint8_t>(10 * number))));
    if (number == 4) four = content();
    file->mark(number);
  }
  struct stat before {
  }, after{};
  ::stat(journal.c_str(), &before);
  file->forget(4);
  ::stat(journal.c_str(), &after);
  EXPECT_LT(after.st_blocks, before.st_blocks);
  EXPECT_LE(file->journalBytes(), kSlots * (kBytes + 100));
  kill();
  EXPECT_FALSE(file->rollBack(3));
  ASSERT_TRUE(file->rollBack(4));
  EXPECT_EQ(content(), four);
  file->forget(UINT64_MAX);
  EXPECT_EQ(file->journalBytes(), 0U);
  EXPECT_FALSE(file->rollBack(4));
}

TEST_F(MarkedSlots, RememberSoManyMarksAndNoMore) {
  constexpr std::size_t kMarks = SlotJournal::kMostMarks + 10;
  for (std::size_t number = 1; number <= kMarks; ++number) {
    file->mark(number);
    ASSERT_TRUE(file->write(0, blockOf(static_cast<std::uint8_t>(number))));
  }
  kill();
  EXPECT_FALSE(file->rollBack(10));
  ASSERT_TRUE(file->rollBack(11));
  EXPECT_EQ(content()[0], blockOf(10));
}

TEST_F(MarkedSlots, ADiskThatRefusesTheJournalCostsTheMarksNotTheSlots) {
  for (std::size_t slot = 0; slot < kSlots; ++slot) ASSERT_TRUE(file->write(slot, blockOf(1)));
  file->mark(1);
  {
    const test::FullDisk full(kSlots * kBytes);
    for (std::size_t slot = 0; slot < kSlots; ++slot) ASSERT_TRUE(file->write(slot, blockOf(2)));
  }
  EXPECT_EQ(content(), std::vector<Block>(kSlots, blockOf(2)));
  EXPECT_FALSE(file->rollBack(1));
  kill();
  EXPECT_FALSE(file->rollBack(1));
  EXPECT_EQ(content(), std::vector<Block>(kSlots, blockOf(2)));
  file->mark(2);
  ASSERT_TRUE(file->write(3, blockOf(3)));
  ASSERT_TRUE(file->rollBack(2));
  EXPECT_EQ(content(), std::vector<Block>(kSlots, blockOf(2)));
}

// The journal's last record is cut short: its slot has not been written.
class CutShort : public MarkedSlots {
 protected:
  void SetUp() override {
    for (std::size_t slot = 0; slot < kSlots; ++slot) ASSERT_TRUE(file->write(slot, blockOf(1)));
    file->mark(1);
    ASSERT_TRUE(file->write(7, blockOf(2)));
    whole = std::filesystem::file_size(journal);
    ASSERT_TRUE(file->write(8, blockOf(2)));
    file.reset();
    std::fstream slots(name, std::ios::in | std::ios::out | std::ios::binary);
    slots.seekp(8 * kBytes);
    slots.write(reinterpret_cast<const char*>(blockOf(1).data()), kBytes);
  }
  [[nodiscard]] bool rollsBack() {
    file = std::make_unique<SlotFile>(SlotFile::Named{name, true}, kSlots, kBytes);
    return file->rollBack(1) && content() == std::vector<Block>(kSlots, blockOf(1));
  }
  void damage(std::uint64_t at) const {
    std::vector<std::uint8_t> bytes = test::readBytes(journal);
    bytes[at] ^= 1;
    test::writeBytes(journal, bytes);
  }
  std::uint64_t whole = 0;
};

TEST_F(CutShort, IsNothingAfterKill9) {
  const std::vector<std::uint8_t> all = test::readBytes(journal);
  const std::vector<std::uint8_t> slots = test::readBytes(name);
  for (const std::uint64_t left : {1000U, 40U, 10U, 0U}) {
    test::writeBytes(name, slots);
    test::writeBytes(journal, {all.begin(), all.begin() + static_cast<std::ptrdiff_t>(whole + left)});
    EXPECT_TRUE(rollsBack()) << left;
    // A truncated record does not prevent later ones.
    ASSERT_TRUE(file->write(7, blockOf(3)));
    file.reset();
    EXPECT_TRUE(rollsBack()) << left;
  }
}

TEST_F(CutShort, AfterTheMachineWasOffWhatCameBeforeCountsAndSlotsNeedACheck) {
  constexpr std::uint64_t kBoot = 8;  // where the head has the boot
  std::filesystem::resize_file(journal, whole + 1000);
  damage(kBoot);
  EXPECT_TRUE(rollsBack());
  EXPECT_TRUE(file->needsCheck());
  // Until somebody has looked, also when the program is started again.
  EXPECT_TRUE(rollsBack());
  EXPECT_TRUE(file->needsCheck());
  file->checked();
  EXPECT_TRUE(rollsBack());
  EXPECT_FALSE(file->needsCheck());
}

TEST_F(CutShort, DamageInTheMiddleLeavesWhatCameBefore) {
  ASSERT_TRUE(rollsBack());
  EXPECT_FALSE(file->needsCheck());
  ASSERT_TRUE(file->write(7, blockOf(2)));
  const std::uint64_t first = std::filesystem::file_size(journal);
  ASSERT_TRUE(file->write(8, blockOf(2)));
  damage(first + 20);
  file = std::make_unique<SlotFile>(SlotFile::Named{name, true}, kSlots, kBytes);
  EXPECT_TRUE(file->needsCheck());
  EXPECT_TRUE(file->rollBack(1));
  std::vector<Block> expected(kSlots, blockOf(1));
  expected[8] = blockOf(2);  // nobody knows what it was
  EXPECT_EQ(content(), expected);
}

}  // namespace
}  // namespace fathom::onboard
