#include <gmock/gmock.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/feature_file.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/topside/pipeline.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/test_data.hpp"
#include "tests/topside/reef_quick.hpp"

namespace fathom::topside {
namespace {

// A simulated dive of about 60 pairs without images, made once by the fixture in CMakeLists.txt.
const std::filesystem::path kMission = FATHOM_FEATURE_MISSION;

nlohmann::json reportOf(const std::filesystem::path& folder) {
  std::ifstream in(folder / "report.json");
  return nlohmann::json::parse(in);
}

TEST(FeatureMission, GivesATrajectoryAndAMapWithinCentimetresOfTheTruth) {
  ASSERT_TRUE(std::filesystem::exists(kMission / "mission.toml")) << "the mission was not made";
  const test::TemporaryFolder out;
  const Summary done = runTopside(kMission, out.path() / "topside", {});
  EXPECT_GE(done.pairs, 58u);
  EXPECT_EQ(done.used, done.pairs);
  EXPECT_EQ(done.unreadable, 0u);

  const Eigen::Vector3d shift = shiftToTruth(kMission, out.path() / "topside", done.pairs, 0.05);

  Mesh mesh = readPly(out.path() / "topside" / "mesh.ply");
  EXPECT_EQ(mesh.colours.size(), mesh.vertices.size());
  transform(mesh, SE3(Eigen::Quaterniond::Identity(), shift));
  const Mesh seafloor = readPly(kMission / "truth" / "terrain.ply");
  const test::SurfaceDistance to_seafloor(seafloor, 0.25F);
  std::vector<float> errors;
  for (const auto& v : mesh.vertices) errors.push_back(to_seafloor(v));
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.02F);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.06F);

  const nlohmann::json report = reportOf(out.path() / "topside");
  EXPECT_EQ(report.at("source"), "features");
  EXPECT_TRUE(report.at("lighting").is_null());
  EXPECT_EQ(report.at("localisation").at("frames"), done.pairs);
}

TEST(FeatureMission, ADamagedFileCostsItsPairAndIsNamed) {
  const test::TemporaryFolder folder;
  const auto mission = folder.path() / "mission";
  std::filesystem::copy(kMission, mission, std::filesystem::copy_options::recursive);
  const io::MissionPaths paths(mission);
  const PairList list = listPairs(paths, io::readMissionConfig(mission), 0.05);
  EXPECT_TRUE(list.features_only);
  const std::string name = io::featureFileName(list.pairs[7].left);
  std::ofstream(paths.features() / name, std::ios::binary) << "not features";
  std::filesystem::remove(paths.features() / io::featureFileName(list.pairs[9].left));
  const Summary done = runTopside(mission, folder.path() / "topside", {});
  EXPECT_EQ(done.unreadable, 2u);
  EXPECT_EQ(done.used, done.pairs - 2);
  EXPECT_THAT(reportOf(folder.path() / "topside").at("pairs").at("unreadable_images").dump(),
              ::testing::HasSubstr(name));
}

TEST(FeatureMission, WithoutALogItsFilesGiveThePairs) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directories(folder.path() / "features");
  for (const char* name :
       {"PR_20260301_020051_114_LC16.feat", "PR_20260301_020051_614_LC16.feat", "notes.txt"})
    std::ofstream(folder.path() / "features" / name) << "";
  std::ofstream(folder.path() / "vehicle.RAW.auv") << "PAROSCI: 1772330451.0 10.0\n";
  io::writeMissionConfig(folder.path(), {});
  const PairList list = listPairs(io::MissionPaths(folder.path()), {}, 0.05);
  EXPECT_TRUE(list.features_only);
  EXPECT_TRUE(list.from_file_names);
  ASSERT_EQ(list.pairs.size(), 2u);
  EXPECT_EQ(io::featureFileName(list.pairs[1].left), "PR_20260301_020051_614_LC16.feat");
}

// What a run finds where mission.toml has stamps that are so much too late.
nlohmann::json timingWith(double compass_s, double cameras_s) {
  const test::TemporaryFolder folder;
  const auto mission = folder.path() / "mission";
  std::filesystem::copy(kMission, mission, std::filesystem::copy_options::recursive);
  io::MissionConfig config = io::readMissionConfig(mission);
  config.time_offsets.compass += compass_s;
  config.time_offsets.left_camera += cameras_s;
  config.time_offsets.right_camera += cameras_s;
  io::writeMissionConfig(mission, config);
  (void)runTopside(mission, folder.path() / "topside", {});
  return reportOf(folder.path() / "topside").at("localisation").at("timing");
}

TEST(FeatureMission, AnAttitudeSensorThatLagsIsDistinguishedFromLateImages) {
  EXPECT_TRUE(timingWith(0, 0).is_null());
  constexpr double kLate_s = 0.4, kNear_s = 0.2;  // 0.12 measured
  const nlohmann::json attitude = timingWith(kLate_s, 0);
  ASSERT_FALSE(attitude.is_null());
  EXPECT_NEAR(attitude.at("attitude_late_s").get<double>(), kLate_s, kNear_s);
  EXPECT_EQ(attitude.at("images_late_s"), 0);
  const nlohmann::json images = timingWith(0, kLate_s);
  ASSERT_FALSE(images.is_null());
  EXPECT_NEAR(images.at("images_late_s").get<double>(), -kLate_s, kNear_s);
  EXPECT_EQ(images.at("attitude_late_s"), 0);
}

// By less than what their steps tell apart beyond doubt: what filters is late, and nothing is early.
TEST(FeatureMission, AShortLagIsTheAttitudeSensors) {
  for (const double late_s : {0.1, 0.2, 0.3}) {
    const nlohmann::json timing = timingWith(late_s, 0);
    ASSERT_FALSE(timing.is_null()) << late_s;
    EXPECT_NEAR(timing.at("attitude_late_s").get<double>(), late_s, 0.16) << late_s;  // 0.08 measured
    EXPECT_EQ(timing.at("images_late_s"), 0) << late_s;
  }
}

void makeFeatures(const sim::Scenario& scenario, const std::filesystem::path& mission) {
  (void)sim::makeMission(scenario,
                         {.out = mission, .force = false, .threads = 0, .features = true, .progress = {}});
}

// Of ranges of 2 m, as a run found.
double tooLong(const nlohmann::json& rig) {
  return rig.at("ranges_too_long").get<double>() + 2 * rig.at("ranges_too_long_per_m").get<double>();
}

// Moves the calibration's apart along the baseline, by a share of the image's width [px]: what ranges of 2 m
// are then too long by.
double movePrincipalPoints(const std::filesystem::path& mission, double share) {
  StereoRig rig = readStereoCalib(mission / "stereo.calib");
  const double off = share * rig.left.width;
  rig.left.cx += off, rig.right.cx -= off;
  writeStereoCalib(mission / "stereo.calib", rig);
  return 2 * off * 2 / (rig.left.fx * rig.baseline());
}

sim::Scenario campaignDive() {
  return sim::loadScenario(FATHOM_SOURCE_DIR "/sim/scenarios/campaign.toml");
}

// The rig as a run finds it in a simulated dive; `disturb` changes the mission before.
nlohmann::json rigFoundIn(const sim::Scenario& scenario,
                          const std::function<void(const std::filesystem::path& mission)>& disturb = {}) {
  const test::TemporaryFolder folder;
  const auto mission = folder.path() / "mission";
  makeFeatures(scenario, mission);
  if (disturb) disturb(mission);
  (void)runTopside(mission, folder.path() / "topside", {});
  return reportOf(folder.path() / "topside").at("rig");
}

// A DVL that is thirty times as noisy as it states: the ranges are not taken from the few steps that agree
// with it by chance.
TEST(FeatureMission, ANoisyDvlLeavesTheScaleToTheCameras) {
  sim::Scenario scenario = campaignDive();
  scenario.seed = 1129;
  scenario.sensors.dvl.velocity_sigma_mps = 0.06;
  const nlohmann::json rig = rigFoundIn(scenario);
  const double longer = tooLong(rig);
  std::printf("ranges too long by %.4f, %.4f claimed\n", longer, rig.at("ranges_sigma").get<double>());
  EXPECT_LT(std::abs(longer), 0.002);
}

// Along the baseline, where no epipolar line shows it, and farther than calibrations err.
TEST(FeatureMission, PrincipalPointsThatAreFarOffAreFoundByPathsAndAltitudes) {
  const test::TemporaryFolder folder;
  const auto mission = folder.path() / "mission";
  std::filesystem::copy(kMission, mission, std::filesystem::copy_options::recursive);
  (void)movePrincipalPoints(mission, 0.002);
  const Summary done = runTopside(mission, folder.path() / "topside", {});
  (void)shiftToTruth(mission, folder.path() / "topside", done.pairs, 0.1);
  EXPECT_THAT(done.to_know, ::testing::Contains(::testing::HasSubstr("by what the DVL measures")));
}

// A dive of half a minute without a straight path to speak of.
TEST(FeatureMission, PrincipalPointsThatAreOffAreFoundInADiveThatTurnsAllTheTime) {
  sim::Scenario scenario = campaignDive();
  scenario.plan.line_length = 1;
  scenario.plan.line_spacing = 0.8;
  scenario.plan.lines = 3;
  double truth = 0;
  const nlohmann::json found = rigFoundIn(
      scenario, [&](const std::filesystem::path& mission) { truth = movePrincipalPoints(mission, 0.001); });
  const double longer = tooLong(found);
  std::printf("%d paths: ranges too long by %.4f, %.4f in truth\n", found.at("paths").get<int>(), longer,
              truth);
  EXPECT_NEAR(longer, truth, 0.17 * truth);
}

// For most of a dive along one line: paths and altitudes are both too short, but by different shares.
TEST(FeatureMission, ALayerInTheWaterDoesNotChangeTheRig) {
  sim::Scenario scenario = campaignDive();
  scenario.plan.lines = 1;
  scenario.plan.line_length = 8;
  scenario.plan.cross_lines = 0;
  scenario.sensors.dvl.current_north_mps = 0.15;
  scenario.sensors.dvl.false_bottom = {{48, 62}};
  const nlohmann::json rig = rigFoundIn(scenario);
  const double longer = tooLong(rig);
  std::printf("%d paths: ranges too long by %.4f\n", rig.at("paths").get<int>(), longer);
  EXPECT_LT(std::abs(longer), 0.01);
}

}  // namespace
}  // namespace fathom::topside
