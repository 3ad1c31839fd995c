#include "realtime/onboard/onboard_output.hpp"

#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>

#include "realtime/kernel/state_archive.hpp"
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

}  // namespace
}  // namespace fathom::onboard
