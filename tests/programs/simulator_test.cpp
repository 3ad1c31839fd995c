#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "tests/support/program_run.hpp"

namespace fathom::test {
namespace {

using ::testing::HasSubstr;

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
