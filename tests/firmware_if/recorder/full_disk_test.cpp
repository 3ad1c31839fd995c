// A disk that really is full: a file system of its own, in memory.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/mount.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <thread>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/recording_gaps.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::DivePlayer;
using test::SyntheticDive;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class FullDisk : public ::testing::Test {
 protected:
  void SetUp() override {
    if (::mount("fathom-test", parent_.path().c_str(), "tmpfs", 0, "size=24m") != 0)
      GTEST_SKIP() << "a file system of its own needs the privilege to mount one";
    mounted_ = true;
    RecorderConfig config;
    config.planned_hours = 0;
    config.image_reserve_mib = 8;
    config.log_reserve_mib = 2;
    recorder_ = std::make_unique<Recorder>(folder_, dive_.mission(), dive_.rig(), config, player_.viewOf(),
                                           player_.release());
  }
  void TearDown() override {
    recorder_.reset();
    if (mounted_) ::umount2(parent_.path().c_str(), MNT_DETACH);
  }
  // The recorder looks at the disk every 0.2 s.
  void playOneSecond() {
    for (int i = 0; i < 100; ++i, ++next_) {
      EXPECT_TRUE(player_.offer(*recorder_, next_));
      if (i % 10 == 9) recorder_->work(20);
      if (i % 50 == 49) std::this_thread::sleep_for(std::chrono::milliseconds(210));
    }
  }
  // Something else on the disk takes all but `leave` bytes.
  void fill(std::uint64_t leave) {
    const std::uint64_t free = freeBytes(parent_.path());
    const int fd = ::open((parent_.path() / "ballast").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644);
    const auto have = static_cast<std::uint64_t>(::lseek(fd, 0, SEEK_END));
    const bool taken = free <= leave ||
                       ::posix_fallocate(fd, static_cast<off_t>(have), static_cast<off_t>(free - leave)) == 0;
    EXPECT_TRUE(taken);
    ::close(fd);
  }
  void makeRoom() { std::filesystem::remove(parent_.path() / "ballast"); }

  test::TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_.path() / "dive";
  SyntheticDive::Config dive_config_{320, 240, 50};
  SyntheticDive dive_{dive_config_};
  DivePlayer player_{dive_, dive_config_, 16};
  std::unique_ptr<Recorder> recorder_;
  std::uint64_t next_ = 0;
  bool mounted_ = false;
};

TEST_F(FullDisk, StopsImagesFirstThenRawBytesAndInputsNever) {
  playOneSecond();
  EXPECT_EQ(recorder_->disk(), Recorder::Disk::kRoom);
  EXPECT_EQ(recorder_->counters().images, 4u);

  fill(6 * kMebibyte);
  playOneSecond();
  playOneSecond();
  EXPECT_EQ(recorder_->disk(), Recorder::Disk::kImagesStopped);
  EXPECT_GT(recorder_->counters().images_dropped_disk, 0u);
  const std::uint64_t raw = recorder_->counters().raw_entries;
  EXPECT_EQ(raw, 15u);

  fill(1 * kMebibyte);
  playOneSecond();
  playOneSecond();
  EXPECT_EQ(recorder_->disk(), Recorder::Disk::kRawStopped);
  EXPECT_GT(recorder_->counters().raw_dropped, 0u);

  fill(0);
  playOneSecond();
  playOneSecond();
  EXPECT_EQ(recorder_->disk(), Recorder::Disk::kFull);
  EXPECT_GT(recorder_->counters().write_failures, 0u);
  EXPECT_LT(recorder_->counters().inputs_safe, next_);
  EXPECT_LT(recorder_->diskFreeMib(), 0.01);

  const std::uint64_t images = recorder_->counters().images;
  makeRoom();
  playOneSecond();
  playOneSecond();
  EXPECT_EQ(recorder_->disk(), Recorder::Disk::kRoom);
  EXPECT_GT(recorder_->counters().images, images);
  EXPECT_TRUE(recorder_->close(30).log_whole);
  EXPECT_EQ(recorder_->counters().inputs_safe, next_);
  EXPECT_EQ(player_.blocks().held(), 0u);

  const SyntheticDive::Found found = dive_.check(folder_);
  EXPECT_THAT(found.wrong, IsEmpty());
  EXPECT_EQ(found.inputs, next_);
  EXPECT_EQ(found.skipped, 0u);
  EXPECT_EQ(found.images, recorder_->counters().images);
  EXPECT_EQ(found.images_lost, recorder_->counters().images_dropped_disk);
  const test::RecordingGaps gaps = test::readGaps(folder_);
  EXPECT_EQ(gaps.images, found.images_lost);
  EXPECT_EQ(gaps.raw_entries, recorder_->counters().raw_dropped);
  EXPECT_EQ(gaps.inputs, 0u);
}

TEST_F(FullDisk, SaysSoWhenItEndsSo) {
  playOneSecond();
  fill(0);
  playOneSecond();
  const Recorder::CloseResult closed = recorder_->close(0.3);
  EXPECT_FALSE(closed.log_whole);
  EXPECT_FALSE(closed.raw_auv);
  EXPECT_THAT(closed.text, HasSubstr("No space left on device"));
  EXPECT_THAT(closed.text, HasSubstr("no RAW.auv was written"));
  EXPECT_EQ(recorder_->state(), Recorder::State::kEnded);
  EXPECT_EQ(player_.blocks().held(), 0u);
  makeRoom();
  // What was written before the disk was full is there, and recording can continue.
  const SyntheticDive::Found found = dive_.check(folder_);
  EXPECT_THAT(found.wrong, IsEmpty());
  EXPECT_GE(found.inputs, 100u);
}

TEST_F(FullDisk, TheRoomTakenForTheLogHoldsItWhenTheRestIsFull) {
  RecorderConfig config;
  config.planned_hours = 0.1;
  config.image_reserve_mib = config.log_reserve_mib = 0;
  recorder_ = std::make_unique<Recorder>(parent_.path() / "planned", dive_.mission(), dive_.rig(), config,
                                         player_.viewOf(), player_.release());
  fill(0);
  playOneSecond();
  playOneSecond();
  EXPECT_EQ(recorder_->counters().inputs, next_);
  EXPECT_EQ(recorder_->counters().write_failures, recorder_->counters().images_dropped_disk);
  EXPECT_EQ(recorder_->counters().images, 0u);
}

}  // namespace
}  // namespace fathom::io
