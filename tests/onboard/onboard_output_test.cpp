#include "realtime/onboard/onboard_output.hpp"

#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>

#include "realtime/base/bytes/state_archive.hpp"
#include "tests/support/disk_log.hpp"
#include "tests/support/full_disk.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;

// Rows of second `t`.
void write(OnboardOutput& output, int from, int to) {
  for (int t = from; t < to; ++t) {
    const std::int64_t now = 1'800'000'000'000'000'000 + std::int64_t{t} * 1'000'000'000;
    output.addOdometry(now, SE3(Eigen::Quaterniond::Identity(), {0.1 * t, 1, 2}));
    MapOutput pair;
    pair.pair_index = static_cast<std::uint32_t>(t);
    pair.utc_ns = now;
    pair.keyframe = t / 3;
    pair.T_odom_cam = SE3(Eigen::Quaterniond::Identity(), {0.2 * t, 0, 2});
    output.addStereoPose(pair, "L" + std::to_string(t) + ".tif", "R" + std::to_string(t) + ".tif", 2.5);
    const std::array<std::uint8_t, 5> frame{1, 2, 3, 4, static_cast<std::uint8_t>(t)};
    output.addPacket(now, frame);
    if (t > 4) output.addDownlink(now, frame);
    output.addHealth(now, {{"pairs", t}, {"loss", 0.5 * t}});
  }
}

void finish(OnboardOutput& output) {
  output.placeStereoPoses([](const MapOutput& pair) { return pair.T_odom_cam; });
  output.writeText("report.json", "{}\n");
  output.commit();
}

std::map<std::string, std::string> contentOf(const fs::path& folder) {
  std::map<std::string, std::string> content;
  for (const auto& entry : fs::directory_iterator(folder)) {
    content[entry.path().filename().string()] = test::readText(entry.path());
  }
  return content;
}

std::vector<std::uint8_t> stateOf(OnboardOutput& output) {
  std::vector<std::uint8_t> bytes(4096);
  rt::StateWriter writer(bytes);
  output.save(writer);
  bytes.resize(writer.size());
  return bytes;
}

constexpr OutputFolder::Life kLive{.outlives = true, .reopen = false},
    kAgain{.outlives = true, .reopen = true};

TEST(OnboardOutput, AFolderThatIsGoneOnWithAfterARestartIsTheOneOfOneRun) {
  const test::TemporaryFolder folder;
  OnboardOutput whole(folder.path() / "whole", {});
  write(whole, 0, 20);
  finish(whole);

  for (const int saved_at : {0, 3, 12}) {
    const fs::path place = folder.path() / ("restarted" + std::to_string(saved_at));
    std::vector<std::uint8_t> state;
    {
      OnboardOutput first(place, {}, kLive);
      write(first, 0, saved_at);
      state = stateOf(first);
      write(first, saved_at, 15);  // done again after the restart
    }
    OnboardOutput second(place, {}, kAgain);
    rt::StateReader reader(state);
    ASSERT_TRUE(second.load(reader)) << reader.failure();
    write(second, saved_at, 20);
    finish(second);
    EXPECT_EQ(contentOf(place), contentOf(folder.path() / "whole"));
  }
  EXPECT_TRUE(fs::exists(folder.path() / "whole" / "downlink.bin"));
  EXPECT_FALSE(fs::exists(folder.path() / "whole" / "pairs.tmp"));
}

TEST(OnboardOutput, LoadingInTheMiddleOfARunCutsItsFilesBack) {
  const test::TemporaryFolder folder;
  OnboardOutput whole(folder.path() / "whole", {}), again(folder.path() / "again", {});
  write(whole, 0, 20);
  finish(whole);
  write(again, 0, 4);
  const std::vector<std::uint8_t> state = stateOf(again);
  write(again, 4, 15);
  rt::StateReader reader(state);
  ASSERT_TRUE(again.load(reader)) << reader.failure();
  write(again, 4, 20);
  finish(again);
  EXPECT_EQ(contentOf(folder.path() / "again"), contentOf(folder.path() / "whole"));
}

TEST(OnboardOutput, FilesThatAreShorterThanTheyWereAreRefused) {
  const test::TemporaryFolder folder;
  std::vector<std::uint8_t> state;
  {
    OnboardOutput first(folder.path() / "out", {}, kLive);
    write(first, 0, 10);
    state = stateOf(first);
  }
  fs::resize_file(folder.path() / "out.tmp" / "packets.bin", 10);
  OnboardOutput second(folder.path() / "out", {}, kAgain);
  rt::StateReader reader(state);
  EXPECT_FALSE(second.load(reader));
  EXPECT_STREQ(reader.failure(), "the output's files are shorter than they were");
}

TEST(OnboardOutput, WithoutCommitNothingStaysUnlessItIsToOutliveItsProgram) {
  const test::TemporaryFolder folder;
  {
    OnboardOutput gone(folder.path() / "gone", {});
    OnboardOutput stays(folder.path() / "stays", {}, kLive);
    write(gone, 0, 3);
    write(stays, 0, 3);
  }
  EXPECT_FALSE(fs::exists(folder.path() / "gone.tmp"));
  EXPECT_TRUE(fs::exists(folder.path() / "stays.tmp"));
  OnboardOutput fresh(folder.path() / "stays", {}, kLive);
  write(fresh, 0, 2);
  finish(fresh);
  EXPECT_FALSE(fs::exists(folder.path() / "stays.tmp"));
  std::ifstream rows(folder.path() / "stays" / "health.csv");
  EXPECT_EQ(std::count(std::istreambuf_iterator<char>(rows), {}, '\n'), 3);
}

// Files of a few kilobytes, on a disk that takes no more than the first of them.
constexpr std::size_t kTaken = 3000;  // of every file [B]
constexpr int kFullFrom = 10, kFullTo = 300, kEnd = 320;

TEST(OnboardOutput, ADiskThatIsFullForAWhileCostsNoRow) {
  const test::TemporaryFolder folder;
  OnboardOutput whole(folder.path() / "whole", {}), late(folder.path() / "late", {});
  write(whole, 0, kEnd);
  finish(whole);
  write(late, 0, kFullFrom);
  EXPECT_TRUE(late.readyToSave());
  {
    const test::FullDisk full(kTaken);
    write(late, kFullFrom, kFullTo);
    EXPECT_FALSE(late.readyToSave());
    EXPECT_FALSE(late.diskTakesData());
    EXPECT_NE(late.failure().find(": File too large"), std::string::npos) << late.failure();
  }
  EXPECT_FALSE(late.lost());
  EXPECT_TRUE(late.diskTakesData());
  EXPECT_EQ(late.failure(), "");
  EXPECT_TRUE(late.readyToSave());
  write(late, kFullTo, kEnd);
  finish(late);
  EXPECT_EQ(contentOf(folder.path() / "late"), contentOf(folder.path() / "whole"));
}

TEST(OnboardOutput, StateSavedWhileRowsWaitIsRefusedByTheNextProgram) {
  const test::TemporaryFolder folder;
  std::vector<std::uint8_t> state;
  {
    OnboardOutput first(folder.path() / "out", {}, kLive);
    const test::FullDisk full(kTaken);
    write(first, 0, kFullTo);
    state = stateOf(first);
  }
  OnboardOutput second(folder.path() / "out", {}, kAgain);
  rt::StateReader reader(state);
  EXPECT_FALSE(second.load(reader));
}

TEST(OnboardOutput, RowsThatFitNoBufferAreLostAndOnlyEarlierStateMakesTheFolderWhole) {
  const test::TemporaryFolder folder;
  OnboardOutput whole(folder.path() / "whole", {}), output(folder.path() / "out", {}, kLive);
  constexpr int kTooMany = 3000;
  write(whole, 0, kTooMany);
  finish(whole);
  write(output, 0, kFullFrom);
  ASSERT_TRUE(output.readyToSave());
  const std::vector<std::uint8_t> before = stateOf(output);
  {
    const test::FullDisk full(kTaken);
    write(output, kFullFrom, kTooMany);
  }
  EXPECT_TRUE(output.lost());
  EXPECT_TRUE(output.diskTakesData());
  EXPECT_NE(output.failure().find("pairs.tmp"), std::string::npos) << output.failure();
  EXPECT_NE(output.failure().find("rows are lost"), std::string::npos) << output.failure();
  EXPECT_FALSE(output.readyToSave());
  EXPECT_THROW(finish(output), std::runtime_error);
  EXPECT_FALSE(fs::exists(folder.path() / "out"));
  rt::StateReader reader(before);
  ASSERT_TRUE(output.load(reader)) << reader.failure();
  EXPECT_FALSE(output.lost());
  write(output, kFullFrom, kTooMany);
  finish(output);
  EXPECT_EQ(contentOf(folder.path() / "out"), contentOf(folder.path() / "whole"));
}

TEST(OnboardOutput, AFileThatCannotBeMadeYetTakesItsRowsLater) {
  const test::TemporaryFolder folder;
  OnboardOutput whole(folder.path() / "whole", {}), late(folder.path() / "late", {});
  write(whole, 0, 20);
  finish(whole);
  const fs::path in_its_place = folder.path() / "late.tmp" / "downlink.bin";
  fs::create_directory(in_its_place);
  write(late, 0, 10);
  EXPECT_FALSE(late.readyToSave());
  EXPECT_EQ(late.failure(), "downlink.bin: Is a directory");
  fs::remove(in_its_place);
  EXPECT_TRUE(late.readyToSave());
  write(late, 10, 20);
  finish(late);
  EXPECT_EQ(contentOf(folder.path() / "late"), contentOf(folder.path() / "whole"));
}

TEST(OnboardOutput, AMapThatCannotBeWrittenIsSaidByCommit) {
  const test::TemporaryFolder folder;
  OnboardOutput output(folder.path() / "out", {});
  write(output, 0, 5);
  fs::create_directory(folder.path() / "out.tmp" / "map.ply.tmp");
  output.writeMap(Mesh());
  EXPECT_NE(output.failure().find("map.ply"), std::string::npos) << output.failure();
  EXPECT_THROW(finish(output), std::runtime_error);
  EXPECT_FALSE(fs::exists(folder.path() / "out"));
}

TEST(OnboardOutput, EveryFileIsOnTheDiskBeforeTheFolderHasItsName) {
  const test::TemporaryFolder folder;
  OnboardOutput output(folder.path() / "out", {});
  write(output, 0, 20);
  test::DiskLog log;
  finish(output);
  const fs::path growing = folder.path() / "out.tmp";
  const std::ptrdiff_t named = log.renamed(growing, folder.path() / "out");
  ASSERT_GE(named, 0);
  for (const auto& [name, content] : contentOf(folder.path() / "out")) {
    EXPECT_GE(log.synced(growing / name), 0) << name;
    EXPECT_LT(log.synced(growing / name), named) << name;
  }
  EXPECT_GE(log.synced(growing), 0);
  EXPECT_LT(log.synced(growing), named);
  EXPECT_GT(log.synced(folder.path()), named);
}

}  // namespace
}  // namespace fathom::onboard
