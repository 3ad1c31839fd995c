// fathom-onboard --live as an operator meets it, on a machine without devices.
#include <gtest/gtest.h>

#include "tests/support/program_run.hpp"

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

}  // namespace
}  // namespace fathom::test
