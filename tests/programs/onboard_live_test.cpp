// fathom-onboard --live as an operator meets it, on a machine without devices.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "tests/support/program_run.hpp"
#include "tests/support/pty_line.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class OnboardLive : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(dive_);
    for (const char* name : {"mission.toml", "stereo.calib"})
      fs::copy_file(fs::path(FATHOM_REEF_MISSION) / name, dive_ / name);
    writeText(folder_.path() / "onboard.toml",
              "[cameras]\nleft = \"absent-left\"\nright = \"absent-right\"\n"
              "[slam]\nmax_pairs = 400\nmax_keyframes = 400\n[recorder]\nplanned_hours = 0.01\n");
  }
  // A script with the program as $live, and `armed FILE` that waits for it to be.
  [[nodiscard]] Outcome run(const std::string& script) const {
    return runCommand("cd " + folder_.path().string() +
                      " && live='" FATHOM_BIN_DIR
                      "/fathom-onboard --live dive --config onboard.toml --soft'\n"
                      "armed() { n=0; until grep -q '^armed' $1; do n=$((n+1)); [ $n -lt 600 ] || exit 9; "
                      "sleep 0.1; done; }\n" +
                      script + "true");
  }

  TemporaryFolder folder_;
  fs::path dive_ = folder_.path() / "dive";
};

TEST_F(OnboardLive, ASecondProgramInTheFolderIsRefusedAndABudgetIsPrintedWithoutATrace) {
  const Outcome all =
      run("$live >out 2>err & first=$!; armed out\n"
          "$live >out2 2>err2; echo second $?\n"
          "size() { stat -c %s dive/sensors.lcmlog; }; find dive | sort > before; s=$(size)\n"
          "$live --print-budget >out3 2>err3; echo budget $?\n"
          "find dive | sort | diff before - && [ $(size) -ge $s ]; echo same $?\n"
          "kill -0 $first; echo lives $?\n" FATHOM_BIN_DIR
          "/fathom-onboard --end dive; echo asked $?\n"
          "wait $first; echo ended $?\n");
  EXPECT_THAT(all.out, HasSubstr("second 2\nbudget 0\nsame 0\nlives 0\n")) << all.out << all.err;
  EXPECT_THAT(all.out, HasSubstr("asked 1\nended 1\n")) << "without cameras there is no map";
  EXPECT_THAT(readText(folder_.path() / "err2"), HasSubstr("another program dives in this folder (process "));
  const std::string budget = readText(folder_.path() / "err3");
  EXPECT_THAT(budget, HasSubstr("left camera's frames"));
  EXPECT_THAT(budget, HasSubstr("map: quadtree"));
  EXPECT_THAT(budget, HasSubstr("saved state"));
}

// With full-size images and every pool as large as the defaults make it.
TEST_F(OnboardLive, BothProcessesAreWithinTheDefaultBudget) {
  writeText(folder_.path() / "default.toml",
            "[cameras]\nleft = \"SIM-1360L\"\nright = \"SIM-1360R\"\n[modem]\ndevice = "
            "\"udp:127.0.0.1:7001\"\n");
  const Outcome plan =
      runCommand("cd " + folder_.path().string() +
                 " && " FATHOM_BIN_DIR
                 "/fathom-sim render reef-quick --features --duration 3 --out full >render && " FATHOM_BIN_DIR
                 "/fathom-onboard --live full --config default.toml --print-budget");
  EXPECT_EQ(plan.exit_code, 0);
  EXPECT_THAT(plan.err, HasSubstr("of 768.00 MiB, fits\nmapper process\n"));
  EXPECT_THAT(plan.err, ::testing::ContainsRegex("both processes .* of 768.00 MiB, fits\n")) << plan.err;
}

TEST_F(OnboardLive, ATermLeavesADiveThatContinuesAndAnEndEndsIt) {
  const Outcome all = run(
      "$live >out 2>err & p=$!; armed out; sleep 1; kill -TERM $p; wait $p; echo left $?\n"
      "$live >out2 2>err2 & p=$!; armed out2; sleep 1; kill -HUP $p; kill -PIPE $p; sleep 0.2; kill -INT $p; "
      "wait $p; echo ended $?\n"
      "$live >out3 2>err3; echo again $?\n");
  EXPECT_THAT(all.out, HasSubstr("left 0\nended 1\nagain 2\n")) << all.out << all.err;
  EXPECT_THAT(readText(folder_.path() / "err"), HasSubstr("the dive is not ended"));
  EXPECT_THAT(readText(folder_.path() / "err2"), HasSubstr("continues this dive"));
  EXPECT_THAT(readText(folder_.path() / "err3"), HasSubstr("this dive has ended"));
  EXPECT_THAT(readText(dive_ / "onboard" / "live.json"), HasSubstr("\"mapper\""));
}

// The commands of the README's five tasks, run as they stand there.

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

TEST(Simulator, RendersAndScoresAMissionInOneJsonLine) {
  const TemporaryFolder folder;
  const std::string scenario = (folder.path() / "tiny.toml").string(),
                    mission = (folder.path() / "m").string();
  writeText(scenario,
            "name = \"tiny\"\nscale = 0.1\n[terrain]\nsize_north_m = 5\nsize_east_m = 5\n"
            "grid_spacing_m = 0.05\nbase_depth_m = 5\n[vehicle]\nfloat_s = 2\n");
  const std::string render = "fathom-sim render " + scenario + " --duration 1 --seed 4 --out " + mission;
  const Outcome rendered = runProgram(render);
  EXPECT_EQ(rendered.exit_code, 0) << rendered.err;
  EXPECT_THAT(rendered.out, HasSubstr("2 pairs"));
  EXPECT_THAT(rendered.err, HasSubstr("pairs: 2 of 2"));
  expectRefused(render, "is not empty");

  const Outcome scored = runProgram("fathom-sim score " + mission + " --json");
  EXPECT_EQ(scored.exit_code, 0);
  const auto json = nlohmann::json::parse(scored.out);
  EXPECT_TRUE(json.at("trajectory").at("dead_reckoning").is_null());
  EXPECT_TRUE(json.at("surface").at("topside").is_null());
  EXPECT_THAT(scored.err, HasSubstr("onboard/map.ply is absent"));
}

}  // namespace
}  // namespace fathom::test
