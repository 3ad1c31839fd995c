// Files, ports and arguments that no program can use.
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fstream>

#include "tests/support/program_run.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// A port of this machine that somebody else has.
class TakenPort {
 public:
  explicit TakenPort(int type) : socket_(::socket(AF_INET, type, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    socklen_t size = sizeof address;
    if (::bind(socket_, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
        (type != SOCK_STREAM || ::listen(socket_, 1) == 0) &&
        ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0)
      number_ = std::to_string(ntohs(address.sin_port));
  }
  ~TakenPort() { ::close(socket_); }
  TakenPort(const TakenPort&) = delete;
  TakenPort& operator=(const TakenPort&) = delete;
  [[nodiscard]] const std::string& number() const { return number_; }

 private:
  int socket_;
  std::string number_;
};

class BadInput : public ::testing::Test {
 protected:
  [[nodiscard]] std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  TemporaryFolder folder_;
};

TEST_F(BadInput, UsageIsRefusedInOneLineByEveryProgram) {
  for (const char* program :
       {"fathom-onboard", "fathom-topside", "fathom-sim", "fathom-monitor", "fathom-sensors"}) {
    expectRefused(program, "");
    expectRefused(std::string(program) + " --nonsense", "");
    EXPECT_EQ(runProgram(std::string(program) + " --help").exit_code, 0);
    EXPECT_THAT(runProgram(std::string(program) + " --version").out,
                ::testing::MatchesRegex(std::string(program) + " [0-9.]+ \\([0-9a-z-]+\\)\n"));
  }
  expectRefused("fathom-onboard --replay x --speed abc", "--speed");
  expectRefused("fathom-topside run x --resolution 0", "--resolution");
  expectRefused("fathom-monitor --udp abc", "--udp");
  for (const char* arguments : {"sonar", "dvl", "can --nonsense x"})
    expectRefused(std::string("fathom-sensors ") + arguments, "");
}

TEST_F(BadInput, AConfigurationThatIsPrintedIsReadAgainAsTheSame) {
  for (const std::string program : {"fathom-onboard --print-config", "fathom-topside run --print-config"}) {
    const Outcome printed = runProgram(program);
    ASSERT_EQ(printed.exit_code, 0) << printed.err;
    EXPECT_THAT(printed.out,
                ::testing::HasSubstr(
                    "\nmax_features = 800  # [corners] 20 to 5000, default 800: wanted in an image\n"));
    std::ofstream(path("printed.toml")) << printed.out;
    EXPECT_EQ(runProgram(program + " --config " + path("printed.toml")).out, printed.out);
    std::ofstream(path("bad.toml")) << "[stereo]\nmax_features = 5\n";
    expectRefused(program + " --config " + path("bad.toml"), "max_features");
  }
}

TEST_F(BadInput, WhatCannotBeSimulatedIsRefused) {
  const std::string out = path("dive");
  for (const char* arguments : {"nonsense", "render", "render demo", "render demo --out", "score",
                                "keys no-such-scenario", "score /nowhere"})
    expectRefused(std::string("fathom-sim ") + arguments, "");
  for (const char* arguments :
       {"no-such-scenario", "demo --scale 7", "demo --scale abc", "demo --duration nan", "demo --threads -1"})
    expectRefused(std::string("fathom-sim render ") + arguments + " --out " + out, "");
  EXPECT_FALSE(fs::exists(out));
}

TEST(Help, EveryProgramAndEachOfItsCommandsShowsACompleteExample) {
  for (const std::string program :
       {"fathom-onboard", "fathom-topside", "fathom-sim", "fathom-monitor", "fathom-sensors"}) {
    const std::string help = runProgram(program + " --help").out;
    EXPECT_THAT(help, ::testing::ContainsRegex("Examples?: " + program + " ")) << help;
    const auto commands = help.find("Subcommands:");
    if (commands == std::string::npos) continue;
    std::istringstream lines(help.substr(commands));
    std::string line;
    std::getline(lines, line);
    while (std::getline(lines, line) && line.starts_with("  ")) {
      if (line[2] == ' ') continue;  // a description continues
      const std::string command = program + " " + line.substr(2, line.find(' ', 2) - 2);
      EXPECT_THAT(runProgram(command + " --help").out, ::testing::HasSubstr("Example: " + command + " "));
    }
  }
}

TEST_F(BadInput, ABadScenarioIsNamed) {
  const std::string scenario = path("s.toml"), out = path("dive");
  for (const Damage kind : kEveryDamage) {
    writeText(scenario, "name = \"x\"\n[plan]\nlines = 2\n[vehicle");
    damage(scenario, kind);
    if (kind == Damage::kHalf) writeText(scenario, "name = \"x\"\n[plan]\nlines = 2\n[vehicle");
    expectRefused("fathom-sim render " + scenario + " --out " + out, scenario + ": ");
    fs::remove_all(scenario);
  }
  EXPECT_FALSE(fs::exists(out) || fs::exists(out + ".partial"));
}

TEST_F(BadInput, AMissionThatCannotBeMadeThereIsRefused) {
  writeText(path("file"), "keep");
  expectRefused("fathom-sim render reef-quick --out " + path("file"), path("file"));
  expectRefused("fathom-sim render reef-quick --out " + path("file/below"), path("file/below"));
  EXPECT_EQ(readText(path("file")), "keep");
}

TEST_F(BadInput, ABadMeshIsNamedAndNoPictureIsWritten) {
  const std::string mesh = path("mesh.ply"), picture = path("picture.png");
  for (const Damage kind : kEveryDamage) {
    fs::copy_file(fs::path(FATHOM_REEF_MISSION) / "truth" / "terrain.ply", mesh);
    damage(mesh, kind);
    expectRefused("fathom-sim picture " + mesh + " --out " + picture, mesh + ": ");
    fs::remove_all(mesh);
  }
  fs::copy_file(fs::path(FATHOM_REEF_MISSION) / "truth" / "terrain.ply", mesh);
  expectRefused("fathom-sim picture " + mesh + " --out " + folder_.path().string(), "--out");
  expectRefused("fathom-sim picture " + mesh + " --out " + path("none/picture.png"), "--out");
  expectRefused("fathom-sim picture " + mesh + " --size 0x0 --out " + picture, "--size");
  EXPECT_FALSE(fs::exists(picture) || fs::exists(picture + ".tmp"));
}

TEST_F(BadInput, AChannelThatCannotRelayIsRefused) {
  const TakenPort taken(SOCK_DGRAM);
  const std::string to = " --to 127.0.0.1:9 --idle-exit 0.1";
  expectRefused("fathom-sim channel --listen 0" + to, "--listen");
  expectRefused("fathom-sim channel --listen 65536" + to, "--listen");
  expectRefused("fathom-sim channel --listen " + taken.number() + to, taken.number());
  expectRefused("fathom-sim channel --listen 14700 --to 127.0.0.1", "--to");
  expectRefused("fathom-sim channel --listen 14700 --to 127.0.0.1:65536", "--to");
  expectRefused("fathom-sim channel --listen 14700 --loss 2" + to, "loss");
  expectRefused("fathom-sim channel --listen 14700 --loss nan" + to, "loss");
  expectRefused("fathom-sim channel --listen 14700 --burst 0.5" + to, "mean_burst");
  expectRefused("fathom-sim channel --listen 14700 --loss 0.9 --burst 2" + to, "longer bursts");
  expectRefused("fathom-sim channel --listen 14700 --down-loss 2" + to, "loss");
}

TEST_F(BadInput, BadPacketsAreNamed) {
  fs::create_directory(path("page"));
  writeText(path("page/index.html"), "<html></html>");
  const std::string packets = path("packets.bin");
  for (const Damage kind : {Damage::kAbsent, Damage::kEmpty, Damage::kFolder, Damage::kNonsense}) {
    damage(packets, kind);
    expectRefused(
        "fathom-monitor --http 0 --exit-after-idle 0 --page " + path("page") + " --packets " + packets,
        packets + ": ");
  }
}

TEST_F(BadInput, PortsThatTheMonitorCannotHaveAreNamed) {
  fs::create_directory(path("page"));
  writeText(path("page/index.html"), "<html></html>");
  const std::string rest = " --exit-after-idle 0 --page " + path("page");
  const TakenPort udp(SOCK_DGRAM), http(SOCK_STREAM);
  expectRefused("fathom-monitor --http 0 --udp 0" + rest, "--udp");
  expectRefused("fathom-monitor --http 0 --udp 65536" + rest, "--udp");
  expectRefused("fathom-monitor --http 0 --bind 0.0.0.0 --udp " + udp.number() + rest, udp.number());
  expectRefused("fathom-monitor --http 0 --udp 14700 --bind nonsense" + rest, "nonsense");
  writeText(path("frames"), "x");
  const std::string recorded = " --packets " + path("frames") + rest;
  expectRefused("fathom-monitor --http 65536" + recorded, "--http");
  expectRefused("fathom-monitor --http-bind 0.0.0.0 --http " + http.number() + recorded, http.number());
  expectRefused("fathom-monitor --http 0 --serial /dev/absent" + rest, "/dev/absent");
  expectRefused("fathom-monitor --http 0 --serial " + path("frames") + rest, path("frames"));
}

TEST_F(BadInput, BadCapturesAreNamed) {
  for (const char* kind_of_capture : {"dvl", "can"}) {
    const std::string capture = path(kind_of_capture);
    for (const Damage kind : {Damage::kAbsent, Damage::kEmpty, Damage::kFolder, Damage::kNonsense}) {
      damage(capture, kind);
      expectRefused("fathom-sensors " + std::string(kind_of_capture) + " " + capture, capture + ": ");
    }
  }
}

TEST_F(BadInput, AModemThatIsNotThereIsNamed) {
  for (const char* modem : {"nonsense", "udp:127.0.0.1:0", "udp:127.0.0.1:65536", "udp:nonsense:14700",
                            "serial:/dev/absent:9600"}) {
    const std::string command =
        "fathom-onboard --replay " FATHOM_REEF_MISSION " --out " + path("out") + " --modem " + modem;
    expectRefused(command, "");
  }
  EXPECT_FALSE(fs::exists(path("out")) || fs::exists(path("out.tmp")));
}

TEST_F(BadInput, ABadDownlinkOrKeyIsNamedBeforeAnythingIsWritten) {
  const std::string replay = "fathom-onboard --replay " FATHOM_REEF_MISSION " --out " + path("out");
  const std::string downlink = path("downlink.bin"), key = path("ship.key"), config = path("onboard.toml");
  for (const Damage kind : {Damage::kAbsent, Damage::kEmpty, Damage::kFolder, Damage::kNonsense}) {
    damage(downlink, kind);  // an empty recording is one of a silent ship
    if (kind != Damage::kEmpty) expectRefused(replay + " --downlink " + downlink, downlink + ": ");
    writeText(config, "[link]\nkey_file = \"ship.key\"\n");
    damage(key, kind);
    expectRefused(replay + " --config " + config, key + ": ");
  }
  EXPECT_FALSE(fs::exists(path("out")) || fs::exists(path("out.tmp")));
}

TEST_F(BadInput, ABadShipIsNamedBeforeAnythingIsWritten) {
  const std::string replay = "fathom-sim replay " FATHOM_REEF_MISSION " --out " + path("out");
  const std::string ship = replay + " --heard " + path("heard.bin");
  expectRefused(replay + " --loss 0.3", "--heard");
  expectRefused(ship + " --loss 2", "loss");
  expectRefused(ship + " --off 20 10", "--off");
  expectRefused(replay + " --heard " + path("nowhere/heard.bin"), path("nowhere/heard.bin"));
  EXPECT_FALSE(fs::exists(path("out")) || fs::exists(path("out.tmp")) || fs::exists(path("heard.bin")));
}

TEST_F(BadInput, AKeyIsMadeOnceAndNowhereElse) {
  const std::string key = path("ship.key");
  EXPECT_EQ(runProgram("fathom-monitor key " + key).exit_code, 0);
  const std::string made = readText(key);
  EXPECT_EQ(made.size(), 65u);
  expectRefused("fathom-monitor key " + key, key + ": exists already");
  EXPECT_EQ(readText(key), made);
  expectRefused("fathom-monitor key " + path("nowhere/ship.key"), path("nowhere/ship.key"));
  expectRefused("fathom-monitor key", "");
}

// Missions with something wrong in them, under the programs that read missions.

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
