#include "realtime/onboard/slots/slot_file.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "realtime/kernel/input_error.hpp"
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

TEST(SlotFile, ANamedOneOfAnotherSizeBeginsAnew) {
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

}  // namespace
}  // namespace fathom::onboard
