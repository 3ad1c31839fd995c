// Which dives a campaign dives, and how it judges them.
#include "sim/campaign/campaign.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <set>

#include "realtime/base/input_error.hpp"
#include "sim/campaign/dose_regression.hpp"
#include "sim/scenario/key_range_check.hpp"
#include "sim/scenario/random.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "tests/support/program_run.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::sim {
namespace {

constexpr std::uint64_t kSeed = 1;

void expectWithinItsKeysRanges(Scenario scenario, const std::string& name) {
  KeyRangeCheck check;
  EXPECT_NO_THROW(visitScenario(check, scenario)) << name;
}

TEST(Campaign, ARoundHasEveryPerturbationAtEveryLevelOnceWithinTheKeysRanges) {
  const std::size_t round = perturbations().size() * Perturbation::kLevels;
  EXPECT_EQ(CampaignOptions().dives, 2 + round);
  std::set<std::pair<int, int>> seen;
  const auto scenarioOf = [](std::size_t dive) {
    return diveScenario(planOf(DiveSeries::kSingle, dive), kSeed);
  };
  const std::string undisturbed[2] = {scenarioToml(scenarioOf(1)), scenarioToml(scenarioOf(0))};
  for (std::size_t k = 2; k < 2 + round; ++k) {
    const DivePlan plan = planOf(DiveSeries::kSingle, k);
    EXPECT_TRUE(seen.emplace(plan.perturbation, plan.level).second);
    const Scenario scenario = scenarioOf(k);
    expectWithinItsKeysRanges(scenario, perturbations()[static_cast<std::size_t>(plan.perturbation)].name);
    EXPECT_EQ(scenarioToml(scenario), scenarioToml(scenarioOf(k)));
    Scenario same_seed = scenario;
    same_seed.seed = scenarioOf(plan.pictures ? 0 : 1).seed;
    EXPECT_NE(scenarioToml(same_seed), undisturbed[plan.pictures ? 1 : 0]) << "it disturbs something";
  }
  EXPECT_EQ(seen.size(), round);
}

TEST(Campaign, ADosesLevelGrowsFromNoneOverUsualToTheExtreme) {
  for (const Perturbation& p : perturbations()) {
    EXPECT_DOUBLE_EQ(p.levelOf(0), p.none) << p.name;
    EXPECT_NEAR(p.levelOf(1), p.usual, 1e-9 * p.usual) << p.name;
    EXPECT_DOUBLE_EQ(p.levelOf(1000), p.levels.back()) << p.name;
    EXPECT_LE(std::abs(p.usual - p.none), std::abs(p.levels.back() - p.none)) << p.name;
  }
}

TEST(Campaign, CombinedDivesHaveAllPerturbationsATenthOfThemBeyondUsual) {
  std::size_t beyond = 0, all = 0;
  std::set<double> to_north, to_south;
  for (std::size_t k = kSites; k < kSites + 200; ++k) {
    const DivePlan plan = planOf(DiveSeries::kTune, k);
    EXPECT_TRUE(plan.pictures);
    for (const double dose : dosesOf(plan, kSeed)) {
      EXPECT_GT(dose, 0);
      beyond += dose > 1 ? 1 : 0, ++all;
    }
    const Scenario scenario = diveScenario(plan, kSeed);
    expectWithinItsKeysRanges(scenario, std::to_string(k));
    ASSERT_EQ(scenario.sensors.compass.jumps.size(), 1u);
    const double jump = scenario.sensors.compass.jumps[0].turn;
    (jump > 0 ? to_north : to_south).insert(jump);
  }
  EXPECT_NEAR(static_cast<double>(beyond) / static_cast<double>(all), 0.1, 0.006)
      << "two standard deviations";
  EXPECT_GT(to_north.size(), 70u) << "both signs";
  EXPECT_GT(to_south.size(), 70u);
}

TEST(Campaign, CombinedDivesReturnToTheSitesOfTheUndisturbedOnes) {
  std::set<std::string> seafloors;
  std::set<double> altitudes, baselines, fields;
  std::set<std::string> reliefs, photographs;
  for (std::size_t k = 0; k < kSites; ++k) {
    const DivePlan calm = planOf(DiveSeries::kTune, k), later = planOf(DiveSeries::kTune, k + 2 * kSites);
    EXPECT_TRUE(calm.undisturbed);
    EXPECT_EQ(undisturbedOf(later), k);
    const Scenario at = diveScenario(calm, kSeed), again = diveScenario(later, kSeed);
    EXPECT_EQ(at.terrain.seed, again.terrain.seed);
    EXPECT_EQ(at.vehicle.follower.altitude_m, again.vehicle.follower.altitude_m);
    EXPECT_NE(at.seed, again.seed);
    EXPECT_TRUE(at.vehicle.collisions.empty() && at.sensors.compass.jumps.empty());
    altitudes.insert(at.vehicle.follower.altitude_m), baselines.insert(at.rig.baseline());
    fields.insert(at.rig.left.fx), reliefs.insert(at.terrain.relief_file),
        photographs.insert(at.terrain.albedo_images);
  }
  EXPECT_EQ(altitudes.size(), kSites);
  EXPECT_EQ(baselines.size(), kSites);
  EXPECT_EQ(fields.size(), kSites);
  EXPECT_EQ(reliefs.size(), 3u) << "grown, a reef, a multibeam survey";
  EXPECT_EQ(photographs.size(), 4u) << "grown, three runs";
}

TEST(Campaign, TheHalfToJudgeByRepeatsNothingOfTheHalfToTuneWith) {
  std::set<double> doses;
  std::set<std::int64_t> seeds;
  for (const DiveSeries series : {DiveSeries::kTune, DiveSeries::kJudge})
    for (std::size_t k = 0; k < 3 * kSites; ++k) {
      const DivePlan plan = planOf(series, k);
      const Scenario scenario = diveScenario(plan, kSeed);
      EXPECT_TRUE(seeds.insert(scenario.seed).second);
      std::vector<double> numbers{scenario.vehicle.speed_mps};
      if (!plan.undisturbed) numbers = dosesOf(plan, kSeed);
      for (const double number : numbers) EXPECT_TRUE(doses.insert(number).second);
    }
}

// Results of known effects: two perturbations that add up, and one pair that is worse together.
TEST(DoseRegression, FindsEffectsAndThePairThatIsWorseTogether) {
  constexpr Eigen::Index kDives = 400, kCount = 12;
  constexpr double kNoise = 0.3;
  Random random(3, "doses");
  Eigen::MatrixXd doses(kDives, kCount);
  Eigen::VectorXd result(kDives), unpaired(kDives);
  for (Eigen::Index i = 0; i < kDives; ++i) {
    for (Eigen::Index j = 0; j < kCount; ++j) doses(i, j) = -std::log(1 - random.uniform()) / std::log(10.0);
    unpaired[i] = 0.7 + 1.0 * doses(i, 2) - 0.5 * doses(i, 5) + random.gauss(kNoise);
    result[i] = unpaired[i] + 2.0 * doses(i, 7) * doses(i, 9);
  }
  const DoseEffects found = regressDoses(doses, result);
  ASSERT_EQ(found.pairs.size(), 1u);
  EXPECT_EQ(found.pairs[0].a, 7u);
  EXPECT_EQ(found.pairs[0].b, 9u);
  EXPECT_NEAR(found.pairs[0].effect, 2.0, 0.5);

  const DoseEffects apart = regressDoses(doses, unpaired);
  EXPECT_TRUE(apart.pairs.empty());
  EXPECT_NEAR(apart.constant, 0.7, 0.1);
  Eigen::VectorXd truth = Eigen::VectorXd::Zero(kCount);
  truth[2] = 1.0, truth[5] = -0.5;
  const Eigen::VectorXd errors = (apart.effect - truth).cwiseQuotient(apart.sigma);
  EXPECT_LT(errors.cwiseAbs().maxCoeff(), 3);
  EXPECT_NEAR(errors.squaredNorm() / kCount, 1, 0.9) << "their standard deviations hold";
}

TEST(DoseRegression, NeedsDives) {
  EXPECT_EQ(regressDoses(Eigen::MatrixXd::Ones(5, 3), Eigen::VectorXd::Ones(5)).effect.size(), 0);
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
  good.plan = planOf(DiveSeries::kJudge, kSites);
  EXPECT_TRUE(failedRequirements(good, good).empty());
  EXPECT_EQ(with([](DiveResult& d) { d.topside_surface_m = 0.03; }).size(), 1u) << "more is asked of these";
  EXPECT_EQ(with([](DiveResult& d) { d.colour_p95 = 9; }).size(), 1u);
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
  EXPECT_EQ(test::runProgram("fathom-sim campaign --out " + out + " --series tune --only 1").exit_code, 2)
      << "of another series";
  std::filesystem::create_directory(folder.path() / "other");
  test::writeText(folder.path() / "other" / "letter.txt", "dear all");
  EXPECT_EQ(test::runProgram("fathom-sim campaign --out " + (folder.path() / "other").string()).exit_code, 2);
}

TEST(Campaign, AsksForTheRealSeafloorsOfItsSitesBeforeItDives) {
  const test::TemporaryFolder folder;
  CampaignOptions options;
  options.out = folder.path() / "campaign";
  options.programs = FATHOM_BIN_DIR;
  options.series = DiveSeries::kTune;
  const char* before = std::getenv("FATHOM_DATA_DIR");
  const std::string kept = before != nullptr ? before : "";
  setenv("FATHOM_DATA_DIR", folder.path().c_str(), 1);
  EXPECT_THROW(runCampaign(options), InputError);
  EXPECT_FALSE(std::filesystem::exists(options.out));
  setenv("FATHOM_DATA_DIR", kept.c_str(), 1);
}

}  // namespace
}  // namespace fathom::sim
