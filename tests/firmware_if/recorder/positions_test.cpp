// Positions of inputs, as the recorder gives them and as the log says them.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/mount.h>
#include <unistd.h>

#include <thread>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/recorder/recorded_dive.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/recording_gaps.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::SyntheticDive;

using Step = LogInputReader::Step;

class Positions : public test::RecordedDive {
 protected:
  std::unique_ptr<Recorder> continued() {
    auto r = recorder();
    r->setFirstPosition(offered_);
    EXPECT_EQ(r->counters().safe_position, offered_);
    return r;
  }
  // The input says its own position, by its time.
  bool offer(Recorder& r) {
    const auto position = static_cast<std::int64_t>(offered_++);
    return r.offerInput({SyntheticDive::kStartUtcNs + position, Tick{}});
  }
  static void workOff(Recorder& r) {
    while (r.work(100)) continue;
  }
  // Every input of the log stands where it was offered; gives how many are missing.
  std::uint64_t checkLog() {
    LogInputReader log(folder_);
    LogInputReader::Entry entry;
    std::uint64_t missing = 0;
    for (Step step; (step = log.next(entry)) != Step::kEnd;) {
      if (step == Step::kMissing) missing += entry.missing;
      if (step == Step::kInput) {
        EXPECT_EQ(entry.input.arrival_utc_ns - SyntheticDive::kStartUtcNs,
                  static_cast<std::int64_t>(entry.position));
      }
    }
    EXPECT_EQ(log.position(), offered_);
    EXPECT_EQ(log.damaged(), 0u);
    return missing;
  }

  std::uint64_t offered_ = 0;  // in all runs
};

TEST_F(Positions, ContinueOverRestartsAndOverInputsWithoutRoom) {
  std::uint64_t refused = 0;
  for (int run = 0; run < 3; ++run) {
    const auto r = continued();
    for (int i = 0; i < 5000; ++i) refused += offer(*r) ? 0 : 1;
    workOff(*r);
    for (int i = 0; i < 10; ++i) EXPECT_TRUE(offer(*r));
    EXPECT_TRUE(r->close(30).log_whole);
    EXPECT_EQ(r->counters().safe_position, offered_);
    EXPECT_GT(refused, 900u * static_cast<unsigned>(run + 1));
  }
  EXPECT_EQ(checkLog(), refused);
}

TEST_F(Positions, CountWhatFoundNoRoomAtTheVeryEnd) {
  std::uint64_t refused = 0;
  {
    const auto r = continued();
    for (int i = 0; i < 5000; ++i) refused += offer(*r) ? 0 : 1;
    const std::uint64_t before = r->counters().safe_position;
    EXPECT_EQ(before, 0u);
    EXPECT_TRUE(r->close(30).log_whole);
    EXPECT_EQ(r->counters().safe_position, 5000u);
  }
  EXPECT_GT(refused, 0u);
  EXPECT_EQ(checkLog(), refused);
}

TEST_F(Positions, OfDecisionsAreTheirOwnAndTakeNoneOfTheInputs) {
  const auto r = continued();
  std::uint64_t refused = 0;
  for (int i = 0; i < 5000; ++i)
    refused += r->offerDecision({SyntheticDive::kStartUtcNs, Decision{1, 0, true}}) ? 0 : 1;
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(offer(*r));
  workOff(*r);
  EXPECT_TRUE(r->offerDecision({SyntheticDive::kStartUtcNs, Decision{2, 0, true}}));
  EXPECT_TRUE(r->close(30).log_whole);
  EXPECT_GT(refused, 0u);
  EXPECT_EQ(r->counters().decisions_dropped, refused);
  EXPECT_EQ(r->counters().decisions_safe, 5001u);
  EXPECT_EQ(r->counters().safe_position, 10u);
  EXPECT_EQ(checkLog(), 0u);
}

TEST_F(Positions, AreSafeOnlyWhenTheDiskHasThem) {
  const auto r = continued();
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(offer(*r));
  r->work(20);  // handed to the system, and not yet synced
  EXPECT_EQ(r->counters().inputs, 10u);
  EXPECT_EQ(r->counters().safe_position, 0u);
  EXPECT_TRUE(r->close(30).log_whole);
  EXPECT_EQ(r->counters().safe_position, 10u);
}

// A disk that really is full: a file system of its own, in memory.

class FullDisk : public test::RecordedDive {
 protected:
  FullDisk() : RecordedDive(320, 240) {}
  void SetUp() override {
    if (::mount("fathom-test", parent_.path().c_str(), "tmpfs", 0, "size=24m") != 0)
      GTEST_SKIP() << "a file system of its own needs the privilege to mount one";
    mounted_ = true;
    recorder_ = recorder({.planned_hours = 0, .image_reserve_mib = 8, .log_reserve_mib = 2});
  }
  void TearDown() override {
    recorder_.reset();
    if (mounted_) ::umount2(parent_.path().c_str(), MNT_DETACH);
  }
  // The recorder looks at the disk every 0.2 s.
  void playOneSecond() {
    for (int half = 0; half < 2; ++half) {
      play(*recorder_, 50);
      std::this_thread::sleep_for(std::chrono::milliseconds(210));
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

  std::unique_ptr<Recorder> recorder_;
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

  const SyntheticDive::Found found = expectInputs(next_);
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
  EXPECT_THAT(closed.text, ::testing::HasSubstr("No space left on device"));
  EXPECT_THAT(closed.text, ::testing::HasSubstr("no RAW.auv was written"));
  EXPECT_EQ(recorder_->state(), Recorder::State::kEnded);
  EXPECT_EQ(player_.blocks().held(), 0u);
  makeRoom();
  // What was written before the disk was full is there, and recording can continue.
  const SyntheticDive::Found found = dive_.check(folder_);
  EXPECT_THAT(found.wrong, ::testing::IsEmpty());
  EXPECT_GE(found.inputs, 100u);
}

TEST_F(FullDisk, TheRoomTakenForTheLogHoldsItWhenTheRestIsFull) {
  RecorderConfig config{.planned_hours = 0.1};
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
