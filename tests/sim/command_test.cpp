#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::sim {
namespace {

struct Outcome {
  int code = -1;
  std::string out, err;
};

// fathom-sim as a person runs it.
class Command : public ::testing::Test {
 protected:
  Outcome run(const std::string& arguments) {
    const auto errors = folder_.path() / "stderr.txt";
    const std::string line =
        std::string(FATHOM_BIN_DIR) + "/fathom-sim " + arguments + " 2>" + errors.string();
    Outcome outcome;
    std::FILE* pipe = ::popen(line.c_str(), "r");
    std::array<char, 4096> buffer{};
    while (const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), pipe))
      outcome.out.append(buffer.data(), n);
    outcome.code = WEXITSTATUS(::pclose(pipe));
    outcome.err = test::readText(errors);
    return outcome;
  }
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  test::TemporaryFolder folder_;
};

TEST_F(Command, BadUsageExitsWithTwo) {
  for (const char* arguments :
       {"", "nonsense", "render", "render demo", "render demo --out", "score",
        "render demo --out /tmp/x --scale abc", "render demo --out /tmp/x --threads -1"})
    EXPECT_EQ(run(arguments).code, 2) << arguments;
}

TEST_F(Command, BadInputExitsWithTwoAndOneLine) {
  std::ofstream(path("bad.toml")) << "name = \"x\"\n[plan]\nlines = 0\n";
  for (const std::string& arguments :
       {"render no-such-scenario --out " + path("m"), "render " + path("bad.toml") + " --out " + path("m"),
        "render demo --scale 7 --out " + path("m"), "render demo --duration nan --out " + path("m"),
        "score " + path("none"), std::string("keys no-such-scenario")}) {
    const Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.code, 2) << arguments;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }
  EXPECT_FALSE(std::filesystem::exists(path("m")));
}

TEST_F(Command, RendersAndScoresAMissionInOneJsonLine) {
  std::ofstream(path("tiny.toml"))
      << "name = \"tiny\"\nscale = 0.1\n[terrain]\nsize_north_m = 5\nsize_east_m = 5\n"
         "grid_spacing_m = 0.05\nbase_depth_m = 5\n[vehicle]\nfloat_s = 2\n";
  const Outcome rendered = run("render " + path("tiny.toml") + " --duration 1 --seed 4 --out " + path("m"));
  EXPECT_EQ(rendered.code, 0) << rendered.err;
  EXPECT_THAT(rendered.out, ::testing::HasSubstr("2 pairs"));
  EXPECT_THAT(rendered.err, ::testing::HasSubstr("pairs: 2 of 2"));
  EXPECT_EQ(run("render " + path("tiny.toml") + " --out " + path("m")).code, 2) << "it is there already";

  const Outcome scored = run("score " + path("m") + " --json");
  EXPECT_EQ(scored.code, 0);
  const auto json = nlohmann::json::parse(scored.out);
  EXPECT_TRUE(json.at("trajectory").at("dead_reckoning").is_null());
  EXPECT_TRUE(json.at("surface").at("topside").is_null());
  EXPECT_THAT(scored.err, ::testing::HasSubstr("onboard/map.ply is absent"));
}

}  // namespace
}  // namespace fathom::sim
