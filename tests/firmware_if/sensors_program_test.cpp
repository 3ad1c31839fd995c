// fathom-sensors as a person runs it: exit codes and the one line of an error.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "tests/support/test_data.hpp"

namespace {

struct Outcome {
  int exit_code = -1;
  std::string output;  // stdout and stderr
};

Outcome sensors(const std::string& arguments) {
  Outcome run;
  // The braces let the arguments send one of the two streams elsewhere.
  const std::string command =
      "{ " + std::string(FATHOM_BIN_DIR) + "/fathom-sensors " + arguments + "; } 2>&1";
  std::FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) return run;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) run.output.push_back(static_cast<char>(c));
  const int status = ::pclose(pipe);
  if (WIFEXITED(status)) run.exit_code = WEXITSTATUS(status);
  return run;
}

TEST(SensorsProgram, HelpShowsAnExample) {
  for (const char* arguments : {"--help", "dvl --help", "can --help"}) {
    const Outcome run = sensors(arguments);
    EXPECT_EQ(run.exit_code, 0);
    EXPECT_NE(run.output.find("Example: fathom-sensors"), std::string::npos) << run.output;
  }
}

TEST(SensorsProgram, BadUsageAndBadInputAreOneLineAndExitCode2) {
  const fathom::test::TemporaryFolder folder;
  const std::string here = folder.path().string();
  const std::vector<std::string> bad = {"",
                                        "sonar",
                                        "dvl",
                                        "can --nonsense x",
                                        "dvl /absent.pd0 --csv",
                                        "can /absent.log --json",
                                        "dvl " + here,
                                        "can " + here,
                                        "dvl /dev/null",
                                        "can /dev/null"};
  for (const std::string& arguments : bad) {
    const Outcome run = sensors(arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_EQ(std::count(run.output.begin(), run.output.end(), '\n'), 1) << arguments << ":\n" << run.output;
  }
}

TEST(SensorsProgram, ADiskThatIsFullIsFailedWork) {
  FATHOM_REQUIRE_DATA("dvl/adcp.adc");
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "this system has no /dev/full";
  const std::string file = fathom::test::dataFile("dvl/adcp.adc").string();
  EXPECT_EQ(sensors("dvl " + file + " --csv >/dev/full").exit_code, 1);
}

TEST(SensorsProgram, CsvAndJsonGoToStandardOutputAndCountsToStandardError) {
  FATHOM_REQUIRE_DATA("dvl/adcp_auv_3.pd0");
  FATHOM_REQUIRE_DATA("can/candumpSample3.txt");
  const Outcome csv =
      sensors("dvl " + fathom::test::dataFile("dvl/adcp_auv_3.pd0").string() + " --csv 2>/dev/null");
  EXPECT_EQ(csv.exit_code, 0);
  EXPECT_EQ(std::count(csv.output.begin(), csv.output.end(), '\n'), 4) << csv.output;
  const Outcome json =
      sensors("can " + fathom::test::dataFile("can/candumpSample3.txt").string() + " --json 2>/dev/null");
  EXPECT_EQ(json.exit_code, 0);
  EXPECT_EQ(json.output.substr(0, json.output.find('\n')),
            R"({"time_s":1502984866.421964,"pgn":127250,"source":204,)"
            R"("fields":{"heading_rad":2.3154,"reference":"magnetic"}})");
}

}  // namespace
