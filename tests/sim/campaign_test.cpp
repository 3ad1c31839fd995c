// Which dives a campaign dives, and how it judges them.
#include "sim/campaign/campaign.hpp"

#include <gtest/gtest.h>

#include <set>

#include "sim/scenario/key_range_check.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "tests/support/program_run.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::sim {
namespace {

TEST(Campaign, ARoundHasEveryPerturbationAtEveryLevelOnceWithinTheKeysRanges) {
  const std::size_t round = perturbations().size() * Perturbation::kLevels;
  std::set<std::pair<int, int>> seen;
  CampaignOptions options;
  const std::string undisturbed[2] = {scenarioToml(diveScenario(options, 1)),
                                      scenarioToml(diveScenario(options, 0))};
  for (std::size_t k = 2; k < 2 + round; ++k) {
    const DiveResult plan = planOf(k);
    EXPECT_TRUE(seen.emplace(plan.perturbation, plan.level).second);
    Scenario scenario = diveScenario(options, k);
    KeyRangeCheck check;
    EXPECT_NO_THROW(visitScenario(check, scenario))
        << perturbations()[static_cast<std::size_t>(plan.perturbation)].name;
    EXPECT_EQ(scenarioToml(scenario), scenarioToml(diveScenario(options, k)));
    Scenario same_seed = scenario;
    same_seed.seed = diveScenario(options, plan.pictures ? 0 : 1).seed;
    EXPECT_NE(scenarioToml(same_seed), undisturbed[plan.pictures ? 1 : 0]) << "it disturbs something";
  }
  EXPECT_EQ(seen.size(), round);
}

TEST(Campaign, JudgesADiveByTheUndisturbedOne) {
  DiveResult good;
  good.onboard_map = good.topside_map = true;
  good.onboard_surface_m = 0.008, good.topside_surface_m = 0.004;
  good.onboard_coverage = good.topside_coverage = 0.95;
  good.nees = 6;
  EXPECT_TRUE(failedRequirements(good, good).empty());
  const auto with = [&](auto change) {
    DiveResult d = good;
    change(d);
    return failedRequirements(d, good);
  };
  const std::vector<std::string> no_map = with([](DiveResult& d) { d.onboard_map = false; });
  EXPECT_EQ(no_map, std::vector<std::string>{"no map on board"});
  EXPECT_EQ(with([](DiveResult& d) { d.topside_coverage = 0.8; }).size(), 1u);
  EXPECT_EQ(with([](DiveResult& d) { d.topside_surface_m = 0.05; }).size(), 1u);
  EXPECT_EQ(with([](DiveResult& d) { d.nees = 30; }).size(), 1u);
  EXPECT_EQ(with([](DiveResult& d) { d.false_closures = 1; }).size(), 1u);
  EXPECT_TRUE(with([](DiveResult& d) { d.onboard_track_m = 1; }).empty())
      << "with pictures the surface counts";
}

TEST(Campaign, DivesKeepsWhatWasDivedAndRefusesAnotherFolder) {
  const test::TemporaryFolder folder;
  const std::string out = (folder.path() / "campaign").string();
  const auto once = test::runProgram("fathom-sim campaign --out " + out + " --only 1");
  ASSERT_EQ(once.exit_code, 0) << once.err;
  const std::string results = test::readText(folder.path() / "campaign" / "results.jsonl");
  EXPECT_NE(results.find("\"topside_map\":true"), std::string::npos) << results;
  EXPECT_NE(results.find("\"onboard_map\":true"), std::string::npos) << results;
  EXPECT_EQ(results.find("\"nees\":null"), std::string::npos) << results;
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "campaign" / "campaign.html"));
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "campaign" / "dive-1" / "mission" / "truth"));
  std::filesystem::create_directory(folder.path() / "other");
  test::writeText(folder.path() / "other" / "letter.txt", "dear all");
  EXPECT_EQ(test::runProgram("fathom-sim campaign --out " + (folder.path() / "other").string()).exit_code, 2);
}

}  // namespace
}  // namespace fathom::sim
