#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>
#include <thread>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/sea/sea_terrain.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::sim {
namespace {

// A few small pairs over a small seafloor.
Scenario tinyScenario() {
  Scenario s;
  s.name = "tiny";
  s.scale = 0.1;
  s.longest_survey_s = 2.0;
  s.terrain.size_north_m = s.terrain.size_east_m = 5.0;
  s.terrain.grid_spacing_m = 0.05;
  s.terrain.base_depth_m = 5.0;
  s.plan.line_length = 2.0;
  s.vehicle.float_s = 3.0;
  s.sensors.usbl.period_s = 2.0;
  return s;
}

MissionMakerReport make(const Scenario& scenario, const std::filesystem::path& out, int threads = 0,
                        bool force = false, bool features = false) {
  return makeMission(scenario,
                     {.out = out, .force = force, .threads = threads, .features = features, .progress = {}});
}

// Every file's bytes by its relative name.
std::map<std::string, std::string> contents(const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    files[entry.path().lexically_relative(folder).string()] = test::readText(entry.path());
  }
  return files;
}

TEST(MissionMaker, AMissionOfFeaturesHasAFilePerPairAndNoImagesAndTheSameBytesForAnyNumberOfThreads) {
  test::TemporaryFolder folder;
  Scenario scenario = tinyScenario();
  scenario.scale = 1;
  const MissionMakerReport report = make(scenario, folder.path() / "one", 1, false, true);
  make(scenario, folder.path() / "two", 2, false, true);
  EXPECT_EQ(contents(folder.path() / "one"), contents(folder.path() / "two"));
  const io::MissionPaths paths(folder.path() / "one");
  EXPECT_TRUE(io::isFeatureMission(paths));
  std::size_t events = 0;
  io::SensorLogReader reader(paths.root);
  while (const auto entry = reader.next()) {
    const auto* event = std::get_if<ImageEvent>(&entry->sample);
    if (event == nullptr || event->side != CameraSide::kLeft) continue;
    ++events;
    const StereoFeatureFrame frame =
        io::readFeatureFile(paths.features() / io::featureFileName(event->file_name));
    EXPECT_EQ(frame.width, scenario.rig.left.width);
    EXPECT_GT(frame.features.size(), 100u);
  }
  EXPECT_EQ(events, report.pairs);
  // All else is as with images.
  const auto log = contents(folder.path() / "one").at("sensors.lcmlog");
  scenario.scale = 0.1;
  make(scenario, folder.path() / "images", 2);
  EXPECT_EQ(contents(folder.path() / "images").at("sensors.lcmlog"), log);
}

TEST(MissionMaker, TheSameSeedGivesTheSameBytesForOneAndTwoThreadsAndAnotherSeedDoesNot) {
  test::TemporaryFolder folder;
  make(tinyScenario(), folder.path() / "one", 1);
  make(tinyScenario(), folder.path() / "two", 2);
  const auto one = contents(folder.path() / "one"), two = contents(folder.path() / "two");
  ASSERT_EQ(one.size(), two.size());
  for (const auto& [name, bytes] : one) EXPECT_TRUE(bytes == two.at(name)) << name;

  Scenario other = tinyScenario();
  other.seed = 99;
  make(other, folder.path() / "other");
  const auto third = contents(folder.path() / "other");
  EXPECT_FALSE(third.at("sensors.lcmlog") == one.at("sensors.lcmlog"));
  EXPECT_FALSE(third.at("truth/trajectory.csv") == one.at("truth/trajectory.csv"));
}

TEST(MissionMaker, RendersWithAsManyThreadsAsItIsGiven) {
  if (std::thread::hardware_concurrency() < 2) GTEST_SKIP() << "this machine has one processor";
  Scenario scenario = tinyScenario();
  scenario.scale = 0.25;
  scenario.longest_survey_s = 6.0;
  for (const int threads : {1, 2}) {
    test::TemporaryFolder folder;
    MissionMakerOptions options;
    options.out = folder.path() / "m";
    options.threads = threads;
    std::set<std::thread::id> seen;
    options.progress = [&](std::size_t, std::size_t) { seen.insert(std::this_thread::get_id()); };
    makeMission(scenario, options);
    EXPECT_EQ(seen.size(), static_cast<std::size_t>(threads));
  }
}

TEST(MissionMaker, WritesTheNominalCalibrationForTheVehicleAndTheTrueOneAsTruth) {
  test::TemporaryFolder folder;
  Scenario scenario = tinyScenario();
  make(scenario, folder.path() / "right");
  CalibrationErrors& e = scenario.calibration_errors;
  e.focal = 0.003, e.centre = 0.002, e.radial = 0.01;
  e.rig_angle = degreesToRadians(0.2), e.rig_position_m = 0.0005;
  e.mounting_angle = degreesToRadians(0.5), e.lever_arm_m = 0.01, e.time_s = 0.02;
  make(scenario, folder.path() / "wrong");
  const io::MissionPaths wrong(folder.path() / "wrong"), truth(wrong.truth());
  const StereoRig rig = readStereoCalib(truth.calib()), nominal = readStereoCalib(wrong.calib());
  EXPECT_EQ(test::readText(truth.calib()), test::readText(io::MissionPaths(folder.path() / "right").calib()));
  EXPECT_NEAR(std::abs(nominal.left.fx / rig.left.fx - 1), 0.003, 1e-6);
  EXPECT_NEAR(std::hypot(nominal.right.cx - rig.right.cx, nominal.right.cy - rig.right.cy),
              0.002 * rig.right.width, 1e-3);
  EXPECT_NEAR(std::abs(nominal.left.k1 - rig.left.k1), 0.01, 1e-6);
  EXPECT_NEAR(nominal.T_right_left.rotation().angularDistance(rig.T_right_left.rotation()),
              degreesToRadians(0.2), 1e-6);
  EXPECT_NEAR((nominal.T_right_left.translation() - rig.T_right_left.translation()).norm(), 0.0005, 1e-6);
  const io::MissionConfig is = io::readMissionConfig(truth.root), says = io::readMissionConfig(wrong.root);
  for (const auto& [a, b] : {std::pair(is.T_body_cam, says.T_body_cam), {is.T_body_dvl, says.T_body_dvl}}) {
    EXPECT_NEAR(a.rotation().angularDistance(b.rotation()), degreesToRadians(0.5), 1e-6);
    EXPECT_NEAR((a.translation() - b.translation()).norm(), 0.01, 1e-6);
  }
  EXPECT_NEAR(std::abs(is.time_offsets.dvl - says.time_offsets.dvl), 0.02, 1e-9);
  scenario.calibration_errors = {};
  scenario.calibration_errors.rig_y = degreesToRadians(-0.3), scenario.calibration_errors.baseline = 0.007;
  make(scenario, folder.path() / "as said");
  const SE3 off = readStereoCalib(io::MissionPaths(folder.path() / "as said").calib()).T_right_left *
                  rig.T_right_left.inverse();
  EXPECT_NEAR(off.log()(4), degreesToRadians(-0.3), 1e-6);
  EXPECT_NEAR(readStereoCalib(io::MissionPaths(folder.path() / "as said").calib()).baseline(),
              1.007 * rig.baseline(), 1e-8);
  // The sea itself is the same.
  const auto files = contents(folder.path() / "right"), same = contents(folder.path() / "wrong");
  for (const char* name : {"sensors.lcmlog", "truth/trajectory.csv"})
    EXPECT_TRUE(files.at(name) == same.at(name));
}

// Mean of an image's samples above the black level.
double brightness(const std::filesystem::path& file) {
  const io::ImageFile image = io::readImage(file, PixelFormat::kMono, 12);
  double sum = 0;
  const auto* samples = static_cast<const std::uint16_t*>(image.view.data);
  const auto count = static_cast<std::size_t>(image.view.width * image.view.height);
  for (std::size_t k = 0; k < count; ++k) sum += samples[k];
  constexpr double kBlack = 0.005 * 4095;
  return sum / static_cast<double>(count) - kBlack;
}

TEST(MissionMaker, StrobesThatVaryAndARightCameraOfMoreGainShowInTheImagesAndInTheTruth) {
  test::TemporaryFolder folder;
  Scenario scenario = tinyScenario();
  scenario.optics.sensor.exposure = 0.4;
  make(scenario, folder.path() / "even");
  scenario.optics.flash_sigma = 0.2;
  scenario.optics.dark_probability = 0.3;
  scenario.optics.sensor.right_gain = 1.5;
  make(scenario, folder.path() / "varied");
  std::ifstream flashes(folder.path() / "varied/truth/exposures.csv"),
      images(folder.path() / "varied/truth/images.csv");
  std::string line, names;
  std::getline(flashes, line), std::getline(images, names);
  int pairs = 0;
  for (; std::getline(flashes, line) && std::getline(images, names); ++pairs) {
    const double energy = std::stod(line.substr(line.rfind(',') + 1));  // of the last strobe, as of all
    const auto first = names.find(','), second = names.find(',', first + 1);
    const std::string left = names.substr(first + 1, second - first - 1), right = names.substr(second + 1);
    const auto ratio = [&](const std::string& name) {
      return brightness(folder.path() / "varied/img" / name) / brightness(folder.path() / "even/img" / name);
    };
    EXPECT_NEAR(ratio(left), energy, 0.01) << left;
    EXPECT_NEAR(ratio(right), 1.5 * energy, 0.015);
  }
  EXPECT_EQ(pairs, 4);
}

TEST(MissionMaker, WritesAMissionThatItsReadersAccept) {
  test::TemporaryFolder folder;
  const io::MissionPaths paths(folder.path() / "m");
  const Scenario scenario = tinyScenario();
  const MissionMakerReport report = make(scenario, paths.root);
  EXPECT_EQ(report.pairs, 4u);

  const io::MissionConfig config = io::readMissionConfig(paths.root);
  EXPECT_EQ(config.start_utc_ns, scenario.start_utc_ns);
  EXPECT_LT((config.T_body_cam.inverse() * scenario.T_body_cam()).log().norm(), 1e-9);
  EXPECT_NEAR(config.time_offsets.left_camera, -0.012, 0.0005 + 1e-12);
  EXPECT_EQ(config.plan.size(), 2u * (3u + 1u));
  const StereoRig rig = readStereoCalib(paths.calib());
  EXPECT_EQ(rig.left.width, 136);
  EXPECT_FALSE(readPly(paths.truth() / "terrain.ply").empty());

  io::SensorLogReader log(paths.root);
  std::size_t samples = 0, images = 0;
  std::int64_t last = 0;
  while (const auto entry = log.next()) {
    EXPECT_GE(entry->arrival_utc_ns, last);
    last = entry->arrival_utc_ns;
    ++samples;
    const auto* image = std::get_if<ImageEvent>(&entry->sample);
    if (image == nullptr) continue;
    ++images;
    const bool left = image->side == CameraSide::kLeft;
    const auto file = io::readImage(paths.images() / image->file_name.view(),
                                    left ? config.cameras.left_format : config.cameras.right_format,
                                    config.cameras.bits, rig.left.width, rig.left.height);
    EXPECT_FALSE(file.view.empty());
  }
  EXPECT_EQ(samples, report.samples);
  EXPECT_EQ(images, 2 * report.pairs);
}

TEST(MissionMaker, OtherPeoplesToolsFindTheSameDepthsAndImagesAsRawAuvText) {
  test::TemporaryFolder folder;
  const io::MissionPaths paths(folder.path() / "m");
  const Scenario scenario = tinyScenario();
  make(scenario, paths.root);
  const auto raw_auv = paths.rawAuv();
  ASSERT_TRUE(raw_auv);
  EXPECT_EQ(raw_auv->filename().string().rfind(scenario.vehicle_name + "_", 0), 0u) << *raw_auv;
  const auto read = [&] {
    io::SensorLogReader log(paths.root);
    std::pair<std::vector<double>, std::vector<std::string>> depths_and_images;
    while (const auto entry = log.next()) {
      if (const auto* depth = std::get_if<DepthSample>(&entry->sample))
        depths_and_images.first.push_back(depth->depth);
      if (const auto* image = std::get_if<ImageEvent>(&entry->sample))
        depths_and_images.second.push_back(image->file_name);
    }
    EXPECT_EQ(log.damagedEntries(), 0u);
    return depths_and_images;
  };
  const auto from_log = read();
  std::filesystem::remove(paths.log());
  const auto from_text = read();
  EXPECT_EQ(from_text.second, from_log.second);
  ASSERT_EQ(from_text.first.size(), from_log.first.size());
  ASSERT_FALSE(from_log.first.empty());
  for (std::size_t i = 0; i < from_log.first.size(); ++i)
    EXPECT_NEAR(from_text.first[i], from_log.first[i], 1e-3);
}

TEST(MissionMaker, TheLogHoldsTheChannelsOfAcfrVehicles) {
  test::TemporaryFolder folder;
  const Scenario scenario = tinyScenario();
  make(scenario, folder.path() / "m");
  const std::string log = contents(folder.path() / "m").at("sensors.lcmlog");
  for (const std::string& channel :
       {std::string("PAROSCI"), std::string("ACFR_AUV_VIS_RAWLOG"), "USBL_FIX." + scenario.vehicle_name})
    EXPECT_NE(log.find(channel), std::string::npos) << channel;
}

TEST(MissionMaker, TheTruthHoldsTheScenarioThatMakesTheSameMissionAgain) {
  test::TemporaryFolder folder;
  Scenario scenario = tinyScenario();
  scenario.longest_survey_s = 1.0;
  make(scenario, folder.path() / "first");
  make(loadScenario((folder.path() / "first/truth/scenario.toml").string()), folder.path() / "again");
  EXPECT_TRUE(contents(folder.path() / "first").at("sensors.lcmlog") ==
              contents(folder.path() / "again").at("sensors.lcmlog"));
}

TEST(MissionMaker, EightBitCamerasWriteEightBitImages) {
  test::TemporaryFolder folder;
  Scenario scenario = tinyScenario();
  scenario.longest_survey_s = 1.0;
  scenario.optics.sensor.bits = 8;
  make(scenario, folder.path() / "m");
  for (const auto& entry : std::filesystem::directory_iterator(folder.path() / "m/img"))
    EXPECT_EQ(io::readImage(entry.path(), PixelFormat::kMono, 8).view.bits, 8);
}

TEST(MissionMaker, DoesNotOverwriteAFolderInUseUnlessForced) {
  test::TemporaryFolder folder;
  const auto out = folder.path() / "m";
  std::filesystem::create_directories(out);
  std::ofstream(out / "mine.txt") << "keep";
  Scenario scenario = tinyScenario();
  scenario.longest_survey_s = 1.0;
  EXPECT_THROW(make(scenario, out), InputError);
  EXPECT_TRUE(std::filesystem::exists(out / "mine.txt"));
  make(scenario, out, 0, true);
  EXPECT_FALSE(std::filesystem::exists(out / "mine.txt"));
  EXPECT_TRUE(std::filesystem::exists(out / "mission.toml"));
  std::ofstream(folder.path() / "file") << "x";
  EXPECT_THROW(make(scenario, folder.path() / "file", 0, true), InputError);
}

TEST(MissionMaker, AFailureLeavesNothingBehind) {
  test::TemporaryFolder folder;
  Scenario scenario = tinyScenario();
  scenario.terrain.kind = TerrainKind::kMesh;
  scenario.terrain.mesh_file = folder.path() / "broken.ply";
  std::ofstream(scenario.terrain.mesh_file) << "no mesh";
  EXPECT_THROW(make(scenario, folder.path() / "m"), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "m"));
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "m.partial"));
}

TEST(WideSeafloor, CarriesOnFlatBeyondTheTerrain) {
  const Scenario scenario = tinyScenario();
  const SeaTerrain terrain(scenario.terrain);
  const WideSeafloor wide(terrain);
  EXPECT_EQ(wide.depthAt(0.5, 0.5), *terrain.depthAt(0.5, 0.5));
  EXPECT_NEAR(wide.depthAt(30, 0), 5.0, 1.5);
  const Eigen::Vector3d slanted = Eigen::Vector3d(1, 0, 1).normalized();
  const auto distance = wide.castRay({10, 0, 1}, slanted);
  ASSERT_TRUE(distance);
  EXPECT_NEAR(1 + *distance * slanted.z(), wide.depthAt(30, 0), 0.5);
  EXPECT_FALSE(wide.castRay({10, 0, 1}, Eigen::Vector3d(0, 0, -1)));
}

}  // namespace
}  // namespace fathom::sim
