// A disk that is slow to sync, or that fails to.
#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "firmware_if/recorder/recorder.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/bad_disk.hpp"

namespace fathom::io {
namespace {

using test::DivePlayer;
using test::SyntheticDive;
using ::testing::IsEmpty;

class FailingDisk : public ::testing::Test {
 protected:
  void SetUp() override {
    RecorderConfig config;
    config.planned_hours = 0;
    config.image_reserve_mib = config.log_reserve_mib = 0;
    recorder_ = std::make_unique<Recorder>(folder_, dive_.mission(), dive_.rig(), config, player_.viewOf(),
                                           player_.release());
  }
  void play(int inputs) {
    for (int i = 0; i < inputs; ++i, ++next_) {
      EXPECT_TRUE(player_.offer(*recorder_, next_));
      if (i % 10 == 9) recorder_->work(20);
    }
  }

  test::TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_.path() / "dive";
  SyntheticDive::Config dive_config_{64, 48, 50};
  SyntheticDive dive_{dive_config_};
  DivePlayer player_{dive_, dive_config_, 16};
  test::BadDisk disk_{parent_.path()};
  std::unique_ptr<Recorder> recorder_;
  std::uint64_t next_ = 0;
};

TEST_F(FailingDisk, WhatASyncDidNotTakeIsWrittenAgain) {
  play(100);
  recorder_->work(1000);
  const std::uint64_t safe = recorder_->counters().inputs_safe;
  EXPECT_GT(safe, 0u);

  const std::uint64_t syncs = recorder_->counters().syncs;
  disk_.set({.fault = test::DiskFault::kInputOutput, .calls = test::kSyncCall});
  play(100);
  std::this_thread::sleep_for(std::chrono::milliseconds(600));  // a sync is due
  recorder_->work(20);
  EXPECT_EQ(recorder_->disk(), Recorder::Disk::kFull);
  EXPECT_EQ(recorder_->counters().inputs_safe, safe);
  EXPECT_EQ(recorder_->counters().syncs, syncs);
  EXPECT_GT(recorder_->counters().syncs_failed, 0u);
  EXPECT_GT(recorder_->counters().write_failures, 0u);
  EXPECT_GT(recorder_->counters().images_dropped_disk, 0u);
  // As if the system had dropped the pages that it could not write.
  const auto log = MissionPaths(folder_).log();
  const auto size = std::filesystem::file_size(log);
  std::filesystem::resize_file(log, size / 2);
  std::filesystem::resize_file(log, size);

  disk_.clear();
  play(100);
  EXPECT_TRUE(recorder_->close(30).log_whole);
  EXPECT_EQ(recorder_->counters().inputs_safe, 300u);
  const SyntheticDive::Found found = dive_.check(folder_);
  EXPECT_EQ(found.inputs, 300u);
  EXPECT_THAT(found.wrong, IsEmpty());
}

TEST_F(FailingDisk, ASlowOneDelaysNoProducerAndLosesNothing) {
  // Each sync, of the log and of each image.
  disk_.set({.fault = test::DiskFault::kStall, .calls = test::kSyncCall, .stall_ms = 100});
  std::atomic<bool> ended{false};
  std::thread writer([&] {
    while (!ended) {
      recorder_->work(50);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const auto start = std::chrono::steady_clock::now();
  for (; next_ < 300; ++next_) {
    EXPECT_TRUE(player_.offer(*recorder_, next_));
    std::this_thread::sleep_until(start + std::chrono::milliseconds(10) * next_);
  }
  ended = true;
  writer.join();
  EXPECT_TRUE(recorder_->close(30).log_whole);
  const Recorder::Counters c = recorder_->counters();
  EXPECT_EQ(c.images, 12u);
  EXPECT_GE(c.worst_sync_ns, 100'000'000);
  EXPECT_GE(c.worst_unsafe_ns, c.worst_sync_ns);
  EXPECT_GE(c.syncs, 4u);
  EXPECT_THAT(dive_.check(folder_).wrong, IsEmpty());
}

}  // namespace
}  // namespace fathom::io
