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

}  // namespace
}  // namespace fathom::onboard
