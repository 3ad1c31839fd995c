// Missions with something wrong in them, under the programs that read missions.
#include <gtest/gtest.h>

#include "tests/support/program_run.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class BadMission : public ::testing::Test {
 protected:
  void SetUp() override {
    const fs::path source = FATHOM_REEF_MISSION;
    ASSERT_TRUE(fs::exists(source / "mission.toml")) << "the mission was not rendered";
    fs::create_directories(mission_ / "img");
    for (const auto& entry : fs::directory_iterator(source))
      if (entry.is_regular_file()) fs::copy_file(entry.path(), mission_ / entry.path().filename());
    for (const auto& entry : fs::directory_iterator(source / "img")) {
      fs::create_symlink(entry.path(), mission_ / "img" / entry.path().filename());
      images_.push_back(mission_ / "img" / entry.path().filename());
    }
    fs::create_directory_symlink(source / "truth", mission_ / "truth");
    std::sort(images_.begin(), images_.end());
    for (const auto& entry : fs::directory_iterator(mission_))
      if (entry.path().string().ends_with(".RAW.auv")) raw_auv_ = entry.path();
  }

  [[nodiscard]] std::string onboard() const { return "fathom-onboard --replay " + mission_.string(); }
  [[nodiscard]] std::string topside() const {
    return "fathom-topside run " + mission_.string() + " --features 100 --no-slam";
  }
  void expectNothingWritten() const {
    for (const char* name : {"onboard", "onboard.tmp", "topside", "topside.tmp"})
      EXPECT_FALSE(fs::exists(mission_ / name)) << name;
  }

  TemporaryFolder folder_;
  fs::path mission_ = folder_.path() / "dive", raw_auv_;
  std::vector<fs::path> images_;
};

TEST_F(BadMission, AFolderThatIsNoMissionIsRefused) {
  writeText(folder_.path() / "file", "x");
  fs::create_directory(folder_.path() / "empty");
  for (const char* name : {"absent", "file", "empty"}) {
    const std::string place = (folder_.path() / name).string();
    expectRefused("fathom-onboard --replay " + place, place);
    expectRefused("fathom-topside run " + place, place);
    expectRefused("fathom-sim score " + place, place);
  }
  EXPECT_TRUE(fs::is_empty(folder_.path() / "empty"));
}

TEST_F(BadMission, ABadFileOfTheMissionIsNamedAndNothingIsWritten) {
  for (const char* name : {"mission.toml", "stereo.calib"}) {
    const std::string good = readText(mission_ / name);
    for (const Damage kind : kEveryDamage) {
      damage(mission_ / name, kind);
      for (const std::string& command : {onboard(), topside()})
        expectRefused(command, (mission_ / name).string() + ": ");
      expectNothingWritten();
    }
    fs::remove(mission_ / name);
    writeText(mission_ / name, good);
  }
}

TEST_F(BadMission, ABadFileThatIsScoredIsNamed) {
  fs::create_directory(mission_ / "onboard");
  for (const char* name : {"onboard/map.ply", "onboard/stereo_pose_est.data", "onboard/odometry.csv"}) {
    for (const Damage kind : {Damage::kEmpty, Damage::kFolder, Damage::kNonsense}) {
      damage(mission_ / name, kind);
      expectRefused("fathom-sim score " + mission_.string(), (mission_ / name).string() + ": ");
      fs::remove(mission_ / name);
    }
  }
  fs::remove(mission_ / "truth");
  expectRefused("fathom-sim score " + mission_.string(), "truth/trajectory.csv: ");
  damage(mission_ / "mission.toml", Damage::kHalf);
  expectRefused("fathom-sim score " + mission_.string(), "mission.toml: ");
}

TEST_F(BadMission, ABadLogIsNamedAndNothingIsWritten) {
  fs::remove(raw_auv_);
  for (const Damage kind : {Damage::kAbsent, Damage::kEmpty, Damage::kFolder, Damage::kNonsense}) {
    damage(mission_ / "sensors.lcmlog", kind);
    expectRefused(onboard(), "sensors.lcmlog");
    expectRefused(topside(), "sensors.lcmlog");
    expectNothingWritten();
  }
}

TEST_F(BadMission, ABadRawAuvInPlaceOfTheLogIsNamed) {
  fs::remove(mission_ / "sensors.lcmlog");
  for (const Damage kind : {Damage::kEmpty, Damage::kFolder, Damage::kNonsense}) {
    damage(raw_auv_, kind);
    expectRefused(onboard(), "RAW.auv");
    expectRefused(topside(), "RAW.auv");
    expectNothingWritten();
  }
}

TEST_F(BadMission, WithoutItsLogItIsMappedFromTheRawAuv) {
  fs::remove(mission_ / "sensors.lcmlog");
  EXPECT_EQ(runProgram(onboard()).exit_code, 0);
  EXPECT_THAT(runProgram(topside()).out, HasSubstr("30 of 30 pairs in the map"));
}

TEST_F(BadMission, ALogCutInTheMiddleGivesTheMapUpToThere) {
  damage(mission_ / "sensors.lcmlog", Damage::kHalf);
  EXPECT_EQ(runProgram(onboard()).exit_code, 0);
  EXPECT_TRUE(fs::exists(mission_ / "onboard" / "map.ply"));
}

TEST_F(BadMission, OneCutImageIsCountedAndTheRestMapped) {
  const fs::path middle = images_[images_.size() / 2];
  damage(middle, Damage::kHalf);
  const Outcome on_board = runProgram(onboard());
  EXPECT_EQ(on_board.exit_code, 0) << on_board.err;
  EXPECT_THAT(on_board.out, HasSubstr("1 unreadable"));
  EXPECT_THAT(on_board.err, HasSubstr(middle.filename().string()));
  const Outcome top_side = runProgram(topside());
  EXPECT_EQ(top_side.exit_code, 0) << top_side.err;
  EXPECT_THAT(top_side.out, HasSubstr("29 of 30 pairs in the map (1 unreadable)"));
}

TEST_F(BadMission, WithoutOneReadableImageThereIsNoMap) {
  for (const fs::path& image : images_) damage(image, Damage::kEmpty);
  for (const std::string& command : {onboard(), topside()}) {
    const Outcome run = runProgram(command);
    EXPECT_EQ(run.exit_code, 2) << run.err;
    ASSERT_FALSE(linesOf(run.err).empty());
    EXPECT_THAT(linesOf(run.err).back(), HasSubstr("30 unreadable"));
    EXPECT_THAT(linesOf(run.err).back(), HasSubstr(".tif: is empty"));
  }
  expectNothingWritten();
}

TEST_F(BadMission, ResultsNeverTakeThePlaceOfWhatIsNotTheirs) {
  const fs::path mine = folder_.path() / "mine", file = folder_.path() / "file";
  fs::create_directory(mine);
  writeText(mine / "notes.txt", "keep");
  writeText(file, "keep");
  for (const std::string& command : {onboard(), topside()}) {
    expectRefused(command + " --out " + mine.string(), "notes.txt");
    expectRefused(command + " --out " + file.string(), file.string());
    expectRefused(command + " --out " + (file / "below").string(), (file / "below").string());
  }
  EXPECT_EQ(readText(mine / "notes.txt"), "keep");
  EXPECT_EQ(readText(file), "keep");
  for (int pass = 0; pass < 2; ++pass) EXPECT_EQ(runProgram(onboard()).exit_code, 0) << "pass " << pass;
}

TEST_F(BadMission, ABadConfigurationIsNamed) {
  const fs::path config = folder_.path() / "config.toml";
  for (const Damage kind : {Damage::kAbsent, Damage::kFolder, Damage::kNonsense}) {
    damage(config, kind);
    expectRefused(onboard() + " --config " + config.string(), config.string());
    expectRefused(topside() + " --config " + config.string(), config.string());
  }
  fs::remove(config);
  writeText(config, "no_such_key = 1\n");
  expectRefused(onboard() + " --config " + config.string(), "line 1, key 'no_such_key'");
  expectRefused(topside() + " --config " + config.string(), "line 1, key 'no_such_key'");
  expectNothingWritten();
}

}  // namespace
}  // namespace fathom::test
