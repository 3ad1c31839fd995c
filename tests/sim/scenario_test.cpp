#include <gmock/gmock.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <stdexcept>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "sim/scenario/random.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::sim {
namespace {

// Loads a scenario from text.
class ScenarioFile : public ::testing::Test {
 protected:
  Scenario load(const std::string& text) {
    const auto path = folder_.path() / "case.toml";
    std::ofstream(path) << text;
    return loadScenario(path.string());
  }
  std::string errorOf(const std::string& text) {
    return test::refusal([&] { (void)load(text); });
  }
  test::TemporaryFolder folder_;
};

TEST_F(ScenarioFile, KeysThatAreNotGivenKeepTheirDefaults) {
  const Scenario given = load("name = \"x\"\n[vehicle]\nspeed_mps = 0.4\n");
  const Scenario defaults;
  EXPECT_EQ(given.vehicle.speed_mps, 0.4);
  EXPECT_EQ(given.vehicle.follower.altitude_m, defaults.vehicle.follower.altitude_m);
  EXPECT_EQ(given.sensors.usbl.angle_sigma, defaults.sensors.usbl.angle_sigma);
  EXPECT_EQ(given.optics.strobes.size(), 2u);
  EXPECT_EQ(given.rig.left.fx, defaults.rig.left.fx);
}

TEST_F(ScenarioFile, ReadsAnglesInDegreesAndListsOfTables) {
  const Scenario given = load(
      "name = \"x\"\n[plan]\nheading_deg = 90.0\n[[terrain.ledges]]\ndrop_m = 2.5\n[[terrain.ledges]]\n"
      "heading_deg = 180\n[optics.water]\nabsorption_per_m = [0.5, 0.2, 0.1]\n");
  EXPECT_DOUBLE_EQ(given.plan.heading, std::numbers::pi / 2);
  ASSERT_EQ(given.terrain.ledges.size(), 2u);
  EXPECT_EQ(given.terrain.ledges[0].drop_m, 2.5);
  EXPECT_DOUBLE_EQ(given.terrain.ledges[1].heading_rad, std::numbers::pi);
  EXPECT_EQ(given.optics.water.absorption_per_m[0], 0.5);
}

TEST_F(ScenarioFile, RefusesAnUnknownKeyAtAnyDepthAndNamesIt) {
  EXPECT_THAT(errorOf("name = \"x\"\nspeeed = 1\n"), ::testing::HasSubstr("speeed"));
  EXPECT_THAT(errorOf("name = \"x\"\n[sensors.dvl]\nrate = 5\n"), ::testing::HasSubstr("sensors.dvl.rate"));
  EXPECT_THAT(errorOf("name = \"x\"\n[[terrain.ledges]]\nheight = 5\n"), ::testing::HasSubstr("height"));
  EXPECT_THAT(errorOf("name = \"x\"\n[nonsense]\na = 5\n"), ::testing::HasSubstr("nonsense"));
}

TEST_F(ScenarioFile, RefusesAValueOutOfRangeAndNamesFileKeyLineAndRange) {
  const std::string error = errorOf("name = \"x\"\n\n[vehicle]\nspeed_mps = 50\n");
  EXPECT_THAT(error, ::testing::HasSubstr("case.toml"));
  EXPECT_THAT(error, ::testing::HasSubstr("vehicle.speed_mps"));
  EXPECT_THAT(error, ::testing::HasSubstr("line 4"));
  EXPECT_THAT(error, ::testing::HasSubstr("2"));
  for (const char* bad : {"[plan]\nlines = 0\n", "[plan]\nlines = 2.5\n", "[optics.sensor]\nbits = 10\n",
                          "[terrain]\nkind = \"moon\"\n", "[sensors.dvl]\nrate_hz = nan\n",
                          "[optics.water]\nabsorption_per_m = [0.1, 0.2]\n", "[terrain]\nkind = \"mesh\"\n",
                          "[vehicle]\nmin_altitude_m = 2.0\n", "[vehicle]\nspeed_mps = \"fast\"\n",
                          "[terrain.rubble]\nmin_size_m = 0.5\nmax_size_m = 0.1\n", "plan = 3\n"}) {
    EXPECT_NE(errorOf(std::string("name = \"x\"\n") + bad), "") << bad;
  }
}

TEST_F(ScenarioFile, RefusesFilesThatAreAbsentEmptyOrNonsense) {
  EXPECT_THROW(static_cast<void>(loadScenario((folder_.path() / "none.toml").string())), InputError);
  EXPECT_THROW(static_cast<void>(loadScenario("no-such-name")), InputError);
  EXPECT_THROW(static_cast<void>(loadScenario(folder_.path().string())), InputError);
  EXPECT_THAT(errorOf(""), ::testing::HasSubstr("name"));
  EXPECT_THAT(errorOf("name = \"x\"\n[plan\n"), ::testing::HasSubstr("line 2"));
  EXPECT_NE(errorOf(std::string("\x00\xff\x89PNG\r\n", 8)), "");
}

TEST_F(ScenarioFile, AMeshThatIsNowhereIsRefusedWithTheFix) {
  const std::string error =
      errorOf("name = \"x\"\n[terrain]\nkind = \"mesh\"\nmesh_file = \"not/there.ply\"\n");
  EXPECT_THAT(error, ::testing::HasSubstr("not/there.ply"));
  EXPECT_THAT(error, ::testing::HasSubstr("FATHOM_DATA_DIR"));
}

TEST_F(ScenarioFile, AMeshIsFoundBesideTheScenarioAndUnderTheDataFolderOfTheEnvironment) {
  const std::string text = "name = \"x\"\n[terrain]\nkind = \"mesh\"\nmesh_file = \"m.ply\"\n";
  test::TemporaryFolder data;
  std::ofstream(data.path() / "m.ply") << "x";
  ::setenv("FATHOM_DATA_DIR", data.path().c_str(), 1);
  EXPECT_EQ(resolvedTerrain(load(text)).mesh_file, data.path() / "m.ply");
  std::ofstream(folder_.path() / "m.ply") << "x";
  EXPECT_EQ(resolvedTerrain(load(text)).mesh_file, folder_.path() / "m.ply");
  ::unsetenv("FATHOM_DATA_DIR");
}

TEST_F(ScenarioFile, WhatIsWrittenReadsBackAsTheSame) {
  const std::string text = scenarioToml(load(
      "name = \"quote \\\" and \\\\ and \\t\"\nseed = 77\n[plan]\nheading_deg = 33.3\n[terrain]\nfish = 4\n"
      "[[terrain.ledges]]\ndrop_m = 1.25\n[[optics.strobes]]\nposition_m = [0.1, 0.2, 0.3]\n"));
  const Scenario again = load(text);
  EXPECT_EQ(scenarioToml(again), text);
  EXPECT_EQ(again.name, "quote \" and \\ and \t");
  EXPECT_EQ(again.optics.strobes.size(), 1u);
  EXPECT_NEAR(again.plan.heading, degreesToRadians(33.3), 1e-13);
}

TEST(ShippedScenarios, EachLoadsByItsName) {
  for (const char* name : {"reef-quick", "reef-grid", "reef-dropoff", "demo"})
    EXPECT_EQ(loadScenario(name).name, name);
}

TEST(ShippedScenarios, TheChamberTombLoadsWhereTheCapturesAre) {
  FATHOM_REQUIRE_DATA("pavlopetri/chamber3.ply");
  EXPECT_TRUE(std::filesystem::equivalent(resolvedTerrain(loadScenario("chamber-tomb")).mesh_file,
                                          test::dataFile("pavlopetri/chamber3.ply")));
}

TEST(ShippedScenarios, ThePageOfKeysIsUpToDate) {
  EXPECT_EQ(test::readText(shippedScenarios() / "defaults.toml"), scenarioToml(Scenario()))
      << "write it again: fathom-sim keys > sim/scenarios/defaults.toml";
}

TEST(Random, StreamsOfOneSeedAreDifferentAndRepeatable) {
  Random a(1, "dvl"), b(1, "dvl"), c(1, "compass"), d(2, "dvl");
  const double first = a.uniform();
  EXPECT_EQ(first, b.uniform());
  EXPECT_NE(first, c.uniform());
  EXPECT_NE(first, d.uniform());
}

TEST(Random, GaussianHasUnitVariance) {
  Random random(3, "test");
  double sum = 0, squares = 0;
  constexpr int kCount = 100000;
  for (int i = 0; i < kCount; ++i) {
    const double v = random.gauss();
    sum += v;
    squares += v * v;
  }
  EXPECT_NEAR(sum / kCount, 0.0, 0.015);
  EXPECT_NEAR(squares / kCount, 1.0, 0.02);
}

// What a file may say the sea takes, and what it may not say a program may not set.
TEST(Ranges, StandWithTheKeysAlone) {
  TerrainConfig terrain;
  terrain.swaying_density_per_m2 = 60;
  EXPECT_NO_THROW(validate(terrain));
  terrain.swaying_density_per_m2 = 101;
  try {
    validate(terrain);
    FAIL() << "taken";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "terrain.swaying_density_per_m2 must be 0 to 100");
  }
  OpticsConfig optics;
  optics.strobes.front().half_angle_rad = degreesToRadians(3);
  EXPECT_THROW(validate(optics), std::invalid_argument);
  optics = {};
  optics.sensor.read_noise_electrons = std::nan("");
  EXPECT_THROW(validate(optics), std::invalid_argument);
}

}  // namespace
}  // namespace fathom::sim
