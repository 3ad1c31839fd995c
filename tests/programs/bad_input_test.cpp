// Files, ports and arguments that no program can use.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/support/program_run.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

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

}  // namespace
}  // namespace fathom::test
