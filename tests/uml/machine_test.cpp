// The user-mode Linux that other tests run their commands in.
#include "tests/uml/machine.hpp"

#include <gmock/gmock.h>

#include <array>
#include <fstream>

#include "tests/support/test_data.hpp"

namespace fathom::uml {
namespace {

using ::testing::HasSubstr;

class UserModeLinux : public ::testing::Test {
 protected:
  void SetUp() override { FATHOM_REQUIRE_USER_MODE_LINUX(); }
  const test::TemporaryFolder folder_;
  const std::string disk_ = (folder_.path() / "disk.img").string();
};

TEST_F(UserModeLinux, GivesBackOutputAndStatusOfACommandThatUsesCan) {
  const MachineRun run = runMachine(
      "--can -- bash -c 'candump -n 1 vcan1 & sleep 0.2; cansend vcan1 09F11201#0102; wait; echo seen >&2; "
      "exit 7'");
  EXPECT_EQ(run.status, 7) << run.output;
  EXPECT_THAT(run.output, HasSubstr("vcan1  09F11201   [2]  01 02"));
  EXPECT_THAT(run.output, HasSubstr("seen"));
}

TEST_F(UserModeLinux, EndsACommandThatHangs) {
  const MachineRun run = runMachine("--limit 4 -- sleep 1000");
  EXPECT_EQ(run.status, 124);
  EXPECT_THAT(run.output, HasSubstr("still running after 4 s"));
}

TEST_F(UserModeLinux, APowerCutKeepsWhatWasSyncedAndLosesWhatWasNot) {
  // What ext4 does not write back by itself within 5 s lives in the machine's memory alone.
  const MachineRun cut = runMachine("--disk " + disk_ + " --format 32 --cut-after 2.5 -- bash -c '" +
                                    "echo kept > $FATHOM_UML_DISK/a; sync; echo lost > $FATHOM_UML_DISK/b; "
                                    "sleep 1000'");
  ASSERT_EQ(cut.status, 0) << cut.output;
  const MachineRun after = runMachine("--disk " + disk_ + " -- bash -c 'cp -a $FATHOM_UML_DISK/. " +
                                      folder_.path().string() + "'");
  ASSERT_EQ(after.status, 0) << after.output;
  EXPECT_TRUE(std::filesystem::exists(folder_.path() / "a"));
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "b"));
}

TEST_F(UserModeLinux, ACutVolatileCacheKeepsWhatWasFlushedAndTearsWhatWasNot) {
  const std::string out = folder_.path().string();
  // The second write is not flushed: O_DIRECT hands it to the drive.
  const MachineRun cut =
      runMachine("--disk " + disk_ + " --format 32 --volatile-cache 7 --cut-after 3 -- bash -c '" +
                 "cd $FATHOM_UML_DISK; " + "head -c 65536 /dev/zero > torn; echo kept > kept; sync; " +
                 "yes written | head -c 65536 > /dev/shm/new; " +
                 "dd if=/dev/shm/new of=torn bs=64k oflag=direct conv=notrunc status=none; " +
                 "echo done > " + out + "/done; sleep 1000'");
  ASSERT_EQ(cut.status, 0) << cut.output;
  ASSERT_TRUE(std::filesystem::exists(folder_.path() / "done")) << "cut too early";
  const MachineRun after = runMachine(
      "--disk " + disk_ + " -- bash -c 'cp $FATHOM_UML_DISK/kept $FATHOM_UML_DISK/torn " + out + "'");
  ASSERT_EQ(after.status, 0) << after.output;
  std::ifstream torn(folder_.path() / "torn", std::ios::binary);
  int new_sectors = 0, old_sectors = 0;
  for (std::array<char, 512> sector; torn.read(sector.data(), sector.size());)
    ++(sector[0] == 0 && sector[511] == 0 ? old_sectors : new_sectors);
  EXPECT_EQ(old_sectors + new_sectors, 128);
  EXPECT_GT(old_sectors, 0);
  EXPECT_GT(new_sectors, 0);
}

TEST_F(UserModeLinux, SaysWhenThereWasNothingToCut) {
  const MachineRun run = runMachine("--cut-after 100 -- true");
  EXPECT_EQ(run.status, 126) << run.output;
}

TEST_F(UserModeLinux, SaysWhyItCouldNotBeSetUp) {
  const std::string not_a_disk = (folder_.path() / "short.img").string();
  ASSERT_EQ(std::system(("head -c 100000 /dev/zero > " + not_a_disk).c_str()), 0);
  const MachineRun run = runMachine("--disk " + not_a_disk + " -- true");
  EXPECT_EQ(run.status, 125);
  EXPECT_THAT(run.output, HasSubstr("could not be set up: mount"));
}

}  // namespace
}  // namespace fathom::uml
