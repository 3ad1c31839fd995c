#include "realtime/onboard/replay.hpp"

#include <gtest/gtest.h>

#include <sstream>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/onboard/onboard_config.hpp"
#include "recon/calibration/sensor_checks.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/geometry/ply.hpp"
#include "telemetry/ship/link_receiver.hpp"
#include "telemetry/wire/packet_log.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/onboard/replayed_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

// A simulated dive of 30 pairs with truth/, rendered by the build before this test runs.
const std::filesystem::path kMission = FATHOM_REEF_MISSION;

ReplayOptions into(const std::filesystem::path& out) {
  return ReplayOptions{.mission = kMission, .config = {}, .out = out, .link = {}, .drain_s = 300};
}

std::map<std::string, double> lastHealth(const std::filesystem::path& file) {
  std::istringstream text(test::readText(file));
  std::string header, row, name, value;
  std::getline(text, header);
  for (std::string line; std::getline(text, line);) row = line;
  std::istringstream names(header), values(row);
  std::map<std::string, double> out;
  while (std::getline(names, name, ',') && std::getline(values, value, ',')) out[name] = std::stod(value);
  return out;
}

// Largest distance of this share of the map's vertices from the true seafloor [m], once it is shifted to
// where the track truly was: GPS does not know that to centimetres.
float offTheSeafloor(const std::filesystem::path& out, double share) {
  const Mesh map = readPly(out / "map.ply"), terrain = readPly(kMission / "truth" / "terrain.ply");
  const test::SurfaceDistance to_seafloor(terrain, 0.25F);
  std::vector<float> errors;
  const Eigen::Vector2f shift = testing::trackError(kMission, out).shift.cast<float>();
  for (const Eigen::Vector3f& v : map.vertices)
    errors.push_back(to_seafloor(v - Eigen::Vector3f(shift.x(), shift.y(), 0)));
  std::sort(errors.begin(), errors.end());
  return errors[static_cast<std::size_t>(share * static_cast<double>(errors.size()))];
}

TEST(OnboardConfig, TellsTheGraphHowFarTheCameraIsFromTheDvl) {
  io::MissionConfig mission;
  mission.T_body_cam = SE3(Eigen::Quaterniond::Identity(), {0.4, 0, 0.1});
  mission.T_body_dvl = SE3(Eigen::Quaterniond::Identity(), {0.0, 0, 0.4});
  EXPECT_NEAR(mapCoreConfig({}, mission, {}).localisation.graph.dvl_in_camera.norm(), 0.5, 1e-12);
}

TEST(Replay, TwoReplaysGiveTheSameBytesInEveryFileButTheTimes) {
  const test::TemporaryFolder folder;
  replay(into(folder.path() / "a"));
  replay(into(folder.path() / "b"));
  EXPECT_EQ(testing::expectSameFiles(folder.path() / "a", folder.path() / "b"), 7);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "a.tmp"));
}

TEST(Replay, TheMapHasTheColoursOfTheMatrixBesideTheCalibration) {
  const test::TemporaryFolder folder;
  const std::filesystem::path mission = folder.path() / "mission";
  std::filesystem::create_directory(mission);
  for (const auto& entry : std::filesystem::directory_iterator(kMission))
    if (entry.path().filename() != "onboard" && entry.path().filename() != "topside")
      std::filesystem::create_symlink(entry.path(), mission / entry.path().filename());
  ReplayOptions options = into(folder.path() / "plain");
  options.mission = mission;
  replay(options);
  // Red and green change places.
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  matrix.row(0).swap(matrix.row(1));
  writeColours(coloursBeside(mission / "stereo.calib"), matrix);
  options.out = folder.path() / "changed";
  replay(options);
  const Mesh plain = readPly(folder.path() / "plain" / "map.ply"),
             changed = readPly(folder.path() / "changed" / "map.ply");
  ASSERT_EQ(plain.colours.size(), changed.colours.size());
  ASSERT_FALSE(plain.colours.empty());
  double off = 0, differs = 0;
  for (std::size_t k = 0; k < plain.colours.size(); ++k) {
    const Rgb &a = plain.colours[k], &b = changed.colours[k];
    off += std::abs(a[0] - b[1]) + std::abs(a[1] - b[0]) + std::abs(a[2] - b[2]);
    differs += std::abs(a[0] - a[1]);
  }
  std::printf("levels a sample: %.2f off, of %.2f\n", off / 3 / static_cast<double>(plain.colours.size()),
              differs / static_cast<double>(plain.colours.size()));
  EXPECT_LT(off / 3, 0.2 * differs);
}

TEST(Replay, LocalisationKeepsTheShapeOfTheTrackAndCanBeSwitchedOff) {
  const test::TemporaryFolder folder;
  replay(into(folder.path() / "localised"));
  ReplayOptions reckoned = into(folder.path() / "reckoned");
  reckoned.no_slam = true;
  replay(reckoned);
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "localised" / "closures.csv"));
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "reckoned" / "closures.csv"));
  // The dive is too short for much drift: centimetres in either direction.
  const double reckoned_error = testing::trackError(kMission, folder.path() / "reckoned").shape;
  EXPECT_LT(testing::trackError(kMission, folder.path() / "localised").shape, std::min(0.03, reckoned_error));
}

TEST(Replay, MapsEveryPairWithinCentimetresOfTheTrueSeafloorUnderTheVehicle) {
  const test::TemporaryFolder folder;
  const ReplaySummary summary = replay(into(folder.path() / "out"));
  EXPECT_GE(summary.pairs_used, 29u);
  EXPECT_EQ(summary.pairs_used, summary.pairs);

  // Relative motion against truth: dead reckoning over this short dive drifts by centimetres.
  const auto truth = io::readTrajectory(kMission / "truth" / "trajectory.csv");
  const auto odometry = io::readTrajectory(folder.path() / "out" / "odometry.csv");
  ASSERT_GT(odometry.size(), 100u);
  const io::TrajectoryPoint &first = odometry[odometry.size() / 4], &last = odometry[3 * odometry.size() / 4];
  const Eigen::Vector3d moved = last.pose.translation() - first.pose.translation();
  const Eigen::Vector3d moved_truly =
      testing::poseAt(truth, last.utc_ns).translation() - testing::poseAt(truth, first.utc_ns).translation();
  const double off = (moved - moved_truly).norm();
  std::printf("half the dive's path off by %.1f mm\n", 1e3 * off);
  EXPECT_LT(off, 0.086);  // twice what was measured

  const float median = offTheSeafloor(folder.path() / "out", 0.5);
  std::printf("map off the seafloor: median %.1f mm\n", 1e3 * static_cast<double>(median));
  EXPECT_LT(median, 0.06F);  // twice what was measured: half a degree of heading is the compass's
}

// The dive of a vehicle with a wrong rig in its files.
ReplayOptions withTurnedRig(const std::filesystem::path& folder, const Eigen::Vector3d& turned,
                            double focal) {
  const std::filesystem::path mission = folder / "mission";
  std::filesystem::create_directories(mission);
  for (const char* name : {"img", "mission.toml", "sensors.lcmlog", "truth"})
    std::filesystem::create_symlink(kMission / name, mission / name);
  writeStereoCalib(mission / "stereo.calib",
                   calibration::changed(readStereoCalib(kMission / "stereo.calib"), {turned, focal, 0}));
  ReplayOptions options = into(folder / "out");
  options.mission = mission;
  return options;
}

constexpr double kTurned = degreesToRadians(0.2);

// Towards the other camera or away from it: stereo can do with it, and every range is 8 % too short or long;
// also those of the first eight pairs, after which it is known.
TEST(Replay, ARigTurnedTooLittleToHurtStereoIsTakenOutOfTheWholeMap) {
  const test::TemporaryFolder folder;
  replay(into(folder.path() / "right"));
  const float right = offTheSeafloor(folder.path() / "right", 0.9);
  for (const double sign : {1, -1}) {
    const std::filesystem::path here = folder.path() / (sign > 0 ? "towards" : "away");
    replay(withTurnedRig(here, {0, sign * kTurned, 0}, 0));
    const auto health = lastHealth(here / "out" / "health.csv");
    EXPECT_NEAR(health.at("rig_turned_y_rad"), -sign * kTurned, 0.1 * kTurned);
    EXPECT_LT(testing::trackError(kMission, here / "out").shape, 0.03);
    EXPECT_LT(offTheSeafloor(here / "out", 0.9), 1.3F * right);
    EXPECT_EQ(health.at("slam_dvl_lies"), 0);
    EXPECT_EQ(health.at("slam_dvl_calibrations"), 0);
    EXPECT_LT(std::abs(health.at("slam_dvl_scale")), 0.002);
  }
}

// A rig knocked by 0.2 degrees, focal lengths 0.6 % apart: half a minute of dive, and 10 pairs until it is
// known.
TEST(Replay, ARigThatHasMovedSinceItWasCalibratedIsFollowed) {
  const test::TemporaryFolder folder;
  const ReplayOptions options = withTurnedRig(folder.path(), {kTurned, 0, 0}, 0.006);
  const ReplaySummary summary = replay(options);
  EXPECT_GE(summary.pairs_used, summary.pairs - 12);
  EXPECT_NE(summary.warning.find("turned by pitch -0.2"), std::string::npos) << summary.warning;
  const auto health = lastHealth(folder.path() / "out" / "health.csv");
  EXPECT_EQ(health.at("rig_changes"), 1);
  EXPECT_NEAR(health.at("rig_turned_x_rad"), -kTurned, 0.02 * kTurned);
  EXPECT_NEAR(health.at("rig_focal_longer"), -0.006, 0.0006);
  // From the first pair on matches are good for the map, and features for links of every keyframe.
  EXPECT_LT(health.at("rejected_epipolar"), 0.01 * health.at("points"));
  EXPECT_EQ(health.at("slam_odometry_refused"), 0);
  EXPECT_EQ(health.at("slam_odometry_links"), health.at("slam_keyframes") - 1);
  replay(into(folder.path() / "right"));
  EXPECT_EQ(lastHealth(folder.path() / "right" / "health.csv").at("rig_changes"), 0);
}

TEST(Replay, EveryFrameOnTheLinkIsValidAndTheRateHolds) {
  const test::TemporaryFolder folder;
  replay(into(folder.path() / "out"));
  telemetry::PacketLogReader packets(folder.path() / "out" / "packets.bin");
  telemetry::LinkReceiver receiver(telemetry::LinkIdentity{1, 1});
  std::map<telemetry::MessageType, int> types;
  std::size_t bytes = 0;
  std::int64_t first_ns = 0, last_ns = 0;
  while (const auto packet = packets.next()) {
    const telemetry::DecodedFrame frame = receiver.accept(packet->bytes, [](const auto&) { return true; });
    ASSERT_EQ(frame.verdict, telemetry::FrameVerdict::kAccepted);
    ++types[frame.header.type];
    bytes += packet->bytes.size();
    if (first_ns == 0) first_ns = packet->utc_ns;
    last_ns = packet->utc_ns;
  }
  EXPECT_GT(types[telemetry::MessageType::kStatus], 3);
  EXPECT_GT(types[telemetry::MessageType::kTrack], 0);
  EXPECT_GT(types[telemetry::MessageType::kMissionInfo], 0);
  EXPECT_GT(types[telemetry::MessageType::kMapPacket], 1);
  constexpr double kRate = 300.0 / 8;  // [B/s]
  EXPECT_LE(static_cast<double>(bytes), kRate * static_cast<double>(last_ns - first_ns) / 1e9 + 3 * 128);
}

TEST(Replay, ADamagedMissionIsRefusedAndTheOldResultsStay) {
  const test::TemporaryFolder folder;
  const auto mission = folder.path() / "mission";
  std::filesystem::create_directories(mission / "onboard");
  std::ofstream(mission / "onboard" / "keep.txt") << "old";
  std::filesystem::copy(kMission / "mission.toml", mission / "mission.toml");
  std::ofstream(mission / "stereo.calib") << "2 1360 1024 nonsense";
  ReplayOptions options;
  options.mission = mission;
  EXPECT_THROW(replay(options), InputError);
  EXPECT_TRUE(std::filesystem::exists(mission / "onboard" / "keep.txt"));
  EXPECT_FALSE(std::filesystem::exists(mission / "onboard.tmp"));
}

TEST(Replay, AnUnreadableImageCostsItsPairOnly) {
  const test::TemporaryFolder folder;
  const auto mission = folder.path() / "mission";
  std::filesystem::copy(kMission, mission, std::filesystem::copy_options::recursive);
  std::vector<std::filesystem::path> images;
  for (const auto& entry : std::filesystem::directory_iterator(mission / "img"))
    images.push_back(entry.path());
  std::sort(images.begin(), images.end());
  std::filesystem::resize_file(images[images.size() / 2], 100);
  ReplayOptions options;
  options.mission = mission;
  const ReplaySummary summary = replay(options);
  EXPECT_EQ(summary.unreadable_images, 1u);
  EXPECT_GE(summary.pairs_used, 28u);
}

}  // namespace
}  // namespace fathom::onboard
