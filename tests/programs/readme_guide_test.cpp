// The commands of the README's five tasks, run as they stand there.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/program_run.hpp"
#include "tests/support/pty_line.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

struct Task {
  std::string name;
  std::vector<std::string> commands;
  int lines = 0;
};

// "**Name.**" begins a task; its block's lines that begin with "$ " are its commands.
std::vector<Task> readTasks() {
  std::istringstream readme(readText(fs::path(FATHOM_SOURCE_DIR) / "README.md"));
  std::vector<Task> tasks;
  bool inside = false;
  for (std::string line; std::getline(readme, line);) {
    if (line.starts_with("## ")) inside = line == "## Five tasks";
    if (!inside || line.starts_with("## ") || line.empty()) continue;
    if (line.starts_with("**")) tasks.push_back({line.substr(2, line.find(".**") - 2), {}});
    if (tasks.empty()) continue;
    ++tasks.back().lines;
    if (line.starts_with("$ ")) tasks.back().commands.push_back(line.substr(2));
  }
  return tasks;
}

// A folder with what the tasks take for granted: a pair, a dive of one's own without mission.toml, today's
// dive.
class ReadmeGuide : public ::testing::Test {
 protected:
  void SetUp() override {
    const fs::path mission = FATHOM_REEF_MISSION;
    fs::create_directories(here_ / "dives/mine");
    fs::create_directories(here_ / "dives/today");
    fs::create_directory_symlink(mission / "img", here_ / "dives/mine/img");
    fs::copy_file(mission / "stereo.calib", here_ / "stereo.calib");
    for (const auto& entry : fs::directory_iterator(mission))
      if (entry.path().string().ends_with(".RAW.auv") || entry.path().filename() == "stereo.calib")
        fs::copy_file(entry.path(), here_ / "dives/mine" / entry.path().filename());
    for (const char* name : {"mission.toml", "stereo.calib"})
      fs::copy_file(mission / name, here_ / "dives/today" / name);
    std::vector<fs::path> images;
    for (const auto& entry : fs::directory_iterator(mission / "img")) images.push_back(entry.path());
    std::sort(images.begin(), images.end());
    for (const fs::path& image : images) {
      if (image.string().find("_LC16") != std::string::npos) left_.push_back(image.string());
      if (image.string().find("_RM16") != std::string::npos) right_.push_back(image.string());
    }
    ASSERT_GT(std::min(left_.size(), right_.size()), 5U);
    writeText(
        here_ / "onboard.toml",
        "[cameras]\nleft = \"absent-left\"\nright = \"absent-right\"\n[link]\nkey_file = \"ship.key\"\n");
  }

  // Here there is neither ship nor camera nor an operator to end the programs that wait; and a name shows
  // that the left image is a colour filter's.
  [[nodiscard]] std::string asRunHere(std::string command) const {
    const std::pair<std::string, std::string> here[] = {
        {"/dev/ttyUSB0", modem_.name()}, {"left.tif", left_[5]}, {"right.tif", right_[5]}};
    for (const auto& [there, instead] : here)
      if (const auto at = command.find(there); at != std::string::npos)
        command.replace(at, there.size(), instead);
    if (command.starts_with("fathom-monitor --serial")) command += " --http 0 --exit-after-idle 1";
    if (command.find("--live") != std::string::npos) command += " --soft --for 1";
    if (command.starts_with("fathom-sensors predive")) command += " --seconds 0.5";
    if (command.starts_with("fathom-topside view"))
      return "timeout --signal=INT 3 " FATHOM_BIN_DIR "/" + command + " --http 0";
    return FATHOM_BIN_DIR "/" + command;
  }
  // Without devices: a red table, and a dive that mapped nothing.
  [[nodiscard]] static int expectedStatus(const std::string& command) {
    if (command.starts_with("fathom-topside view")) return 124;  // ended by timeout
    if (command.starts_with("fathom-onboard --end")) return 2;   // that dive has ended by itself
    const bool needs_devices =
        command.starts_with("fathom-sensors predive") ||
        (command.find("--live") != std::string::npos && command.find("--print-budget") == std::string::npos);
    return needs_devices ? 1 : 0;
  }

  TemporaryFolder folder_;
  fs::path here_ = folder_.path();
  std::vector<std::string> left_, right_;  // images of the dive
  PtyLine modem_;
};

TEST_F(ReadmeGuide, EachCommandOfTheFiveTasksWorksAsItStandsThere) {
  if (!fs::exists(FATHOM_BIN_DIR "/../share/fathom/topside/index.html"))
    GTEST_SKIP() << "the pages that two of the commands show are not built here";
  const std::vector<Task> tasks = readTasks();
  ASSERT_EQ(tasks.size(), 5U);
  for (const Task& task : tasks) {
    EXPECT_LE(task.lines, 10) << task.name;
    ASSERT_FALSE(task.commands.empty()) << task.name;
    if (task.name == "After recovery") {  // of a dive that had cameras
      fs::remove_all(here_ / "dives/today");
      fs::create_directory(here_ / "dives/today");
      for (const auto& entry : fs::directory_iterator(FATHOM_REEF_MISSION))
        fs::create_symlink(entry.path(), here_ / "dives/today" / entry.path().filename());
    }
    for (const std::string& command : task.commands) {
      const Outcome run = runCommand("cd " + here_.string() + " && " + asRunHere(command));
      EXPECT_EQ(run.exit_code, expectedStatus(command)) << command << "\n" << run.out << run.err;
    }
  }
  for (const char* made : {"mesh.ply", "depth.png", "ship.key", "dives/mine/topside/tiles/tileset.json",
                           "dives/today/topside/report.html", "dive-1"})
    EXPECT_TRUE(fs::exists(here_ / made)) << made;
}

}  // namespace
}  // namespace fathom::test
