#include "sim/hil/hil_compare.hpp"
#include "realtime/base/units.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/config_table.hpp"
#include "realtime/base/input_error.hpp"
#include "sim/hil/fault_table.hpp"
#include "sim/hil/hil_folder.hpp"
#include "tests/sim/hil_mission.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::sim {
namespace {

void write(const std::filesystem::path& path, const std::string& text) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << text;
}

io::StereoPose pose(double utc_s, double north) {
  io::StereoPose p;
  p.utc_s = utc_s;
  p.T_nav_cam = SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(north, 0, 5));
  return p;
}

TEST(HilCompare, FoldersDifferByBytesAndByWhatOneLacksButNotByMeasuredTimes) {
  const test::TemporaryFolder folder;
  const auto a = folder.path() / "a", b = folder.path() / "b";
  for (const auto& side : {a, b}) {
    write(side / "same", std::string(200'000, 's'));
    write(side / "timing.json", side.string());
  }
  write(a / "other", "x");
  write(b / "other", "y");
  write(a / "longer", "xx");
  write(b / "longer", "x");
  write(a / "sub/only", "x");
  EXPECT_THAT(differingFiles(a, b), testing::ElementsAre("longer", "other", "sub/only"));
  EXPECT_THAT(differingFiles(a, a), testing::IsEmpty());
}

TEST(HilCompare, PosesAreMatchedByTheMissionsTimeAndPartedIntoTheWholesMotionAndTheirOwn) {
  const TimeShift shift = {kMissionNs + 5000 * kSecond_ns, kMissionNs, 2.0};
  const double mission_s = 1e-9 * static_cast<double>(kMissionNs), run_s = mission_s + 5000;
  const SE3 whole(Eigen::Quaterniond(Eigen::AngleAxisd(0.004, Eigen::Vector3d::UnitZ())),
                  Eigen::Vector3d(0.01, -0.02, 0.001));
  io::StereoPoseFile direct, live;
  for (int i = 0; i < 10; ++i) direct.poses.push_back(pose(mission_s + 0.5 * i, 1.0 * i));
  for (int i = 3; i < 8; ++i) {
    live.poses.push_back(pose(run_s + 0.25 * i + 0.001, 1.0 * i));
    live.poses.back().T_nav_cam = whole * live.poses.back().T_nav_cam;
  }
  live.poses[2].T_nav_cam =
      SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0.005, 0)) * live.poses[2].T_nav_cam;
  live.poses.push_back(pose(run_s + 100, 0));
  const PoseDistances d = comparePoses(live, direct, shift);
  EXPECT_EQ(d.matched, 5U);
  EXPECT_EQ(d.unmatched, 1U);
  EXPECT_NEAR(d.turn_rad, 0.004, 1e-6);
  EXPECT_NEAR(d.moved_m, std::hypot(0.01, -0.02 + 0.001 + 7 * 0.004, 0.001), 1e-4);
  EXPECT_NEAR(d.worst_m, 0.004, 1e-5);  // but for the fifth of it that the whole took
  EXPECT_NEAR(d.rms_m, 0.002, 1e-5);
  EXPECT_LT(d.worst_rad, 1e-6);
}

std::vector<CameraLogRow> exposures(int n, std::int64_t period_ns, std::int64_t off_ns) {
  std::vector<CameraLogRow> log;
  for (int i = 0; i < n; ++i) {
    CameraLogRow row;
    row.mission_s = 0.5 * i;
    row.exposed_utc_ns = kMissionNs + i * period_ns + off_ns;
    row.fate = "sent";
    row.file = std::to_string(i);
    log.push_back(row);
  }
  return log;
}

TEST(HilCompare, APairOfExposuresThatWereNotTakenTogetherIsFound) {
  const auto left = exposures(10, 500 * kMillisecond_ns, 0);
  auto right = exposures(10, 500 * kMillisecond_ns, 3 * kMillisecond_ns);
  right[4].exposed_utc_ns += 40 * kMillisecond_ns;  // late
  io::StereoPoseFile live;
  const auto add = [&](int l, std::int64_t r_ns) {
    io::StereoPose p;
    p.left_image = io::imageFileName(left[static_cast<std::size_t>(l)].exposed_utc_ns + 2 * kMillisecond_ns,
                                     CameraSide::kLeft);
    p.right_image = io::imageFileName(r_ns, CameraSide::kRight);
    live.poses.push_back(p);
  };
  add(1, right[1].exposed_utc_ns);
  add(4, right[4].exposed_utc_ns);
  add(6, right[7].exposed_utc_ns);
  add(8, right[8].exposed_utc_ns + 200 * kMillisecond_ns);
  const PairCheck check = checkPairs(live, left, right, 0.025);
  EXPECT_EQ(check.pairs, 4U);
  EXPECT_EQ(check.mismatched, 2U);
  EXPECT_EQ(check.unknown, 1U);
}

TEST(HilCompare, ACameraLogIsReadByItsColumnsAndItsCutLastLineLeftOut) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "camera.csv";
  write(path,
        "number,mission_s,file,frame_id,device_ns,exposed_utc_ns,fate,packets,packets_lost,late_s\n"
        "0,1.5,a.tif,100,5,1772330401500000000,sent,300,2,0.0001\n"
        "1,2.0,b.tif,101,6,1772330402000000000,lost,0,0,0\n"
        "2,2.5,c.tif,1");
  const auto log = readCameraLog(path);
  ASSERT_EQ(log.size(), 2U);
  EXPECT_EQ(log[0].file, "a.tif");
  EXPECT_EQ(log[0].packets_lost, 2);
  EXPECT_EQ(log[1].fate, "lost");
  EXPECT_EQ(exposureAt(log, 1772330401520000000), &log[0]);
  EXPECT_EQ(exposureAt(log, 1772330401700000000), nullptr);
  write(path, "a,b\n1,2\n");
  EXPECT_THROW((void)readCameraLog(path), InputError);
  EXPECT_THROW((void)readCameraLog(folder.path() / "absent"), InputError);
}

TEST(HilCompare, AFaultThatNoCounterSawMakesTheTableBad) {
  const FaultScript script = parseFaultScript(
      "[[fault]]\nkind = \"lost_packets\"\nat_s = 1\nfor_s = 1\ncamera = \"left\"\n"
      "[[fault]]\nkind = \"lost_packets\"\nat_s = 3\nfor_s = 1\ncamera = \"left\"\nresend = true\n"
      "[[fault]]\nkind = \"lost_frames\"\nat_s = 2\nfor_s = 0.4\ncamera = \"right\"\n",
      "faults.toml");
  auto left = exposures(10, 500 * kMillisecond_ns, 0), right = left;
  left[2].packets_lost = left[3].packets_lost = 1;  // 1 s and 1.5 s
  left[6].packets_lost = 1;                         // sent again
  right[4].fate = "lost";
  nlohmann::json run, live, report;
  run["expected"] = {{"lost_packets", 4}, {"lost_frames", 1}};
  live["devices"]["camera_left"] = {{"incomplete", 2}, {"resent_packets", 1}, {"missed", 0}};
  live["devices"]["camera_right"] = {{"missed", 1}};
  std::FILE* nowhere = std::fopen("/dev/null", "w");
  {
    const FaultTable table(script, run, live, report, left, right);
    EXPECT_TRUE(table.print(nowhere));
    EXPECT_TRUE(table.arrivedComplete(CameraSide::kLeft, left[0]));
    EXPECT_FALSE(table.arrivedComplete(CameraSide::kLeft, left[2]));
    EXPECT_TRUE(table.arrivedComplete(CameraSide::kLeft, left[6]));
    EXPECT_FALSE(table.arrivedComplete(CameraSide::kRight, right[4]));
  }
  live["devices"]["camera_right"]["missed"] = 2;
  EXPECT_FALSE(FaultTable(script, run, live, report, left, right).print(nowhere));
  live["devices"]["camera_right"]["missed"] = 1;
  live["devices"]["camera_left"]["incomplete"] = 0;
  EXPECT_FALSE(FaultTable(script, run, live, report, left, right).print(nowhere));
  std::fclose(nowhere);
}

TEST(HilFolder, OnlyAnEarlierRunIsReplacedAndOnlyWhenAsked) {
  const test::TemporaryFolder temporary;
  const HilFolder folder(temporary.path() / "run");
  makeHilFolder(folder, false);
  EXPECT_THROW(makeHilFolder(folder, false), InputError);
  EXPECT_NO_THROW(makeHilFolder(folder, true));
  write(temporary.path() / "other/file", "precious");
  EXPECT_THROW(makeHilFolder(HilFolder(temporary.path() / "other"), true), InputError);
  EXPECT_TRUE(std::filesystem::exists(temporary.path() / "other/file"));
}

TEST(HilFolder, TheConfigurationKeepsWhatIsGivenAndNamesTheBenchsDevices) {
  const test::TemporaryFolder temporary;
  writeTenSecondMission(temporary.path() / "mission");
  ScheduleOptions when;
  when.start_utc_ns = kMissionNs;
  const MissionSchedule schedule = makeSchedule(temporary.path() / "mission", when);
  const HilFolder folder(temporary.path() / "run");
  makeHilFolder(folder, false);
  write(temporary.path() / "base.toml", "[slam]\nfeatures = 400\n");
  HilOptions options;
  options.config = temporary.path() / "base.toml";
  HilDevices devices;
  devices.left = "FTH-L";
  devices.right = "FTH-R";
  devices.dvl = "serial:" + folder.dvl().string() + ":115200";
  devices.lcm = "udpm://239.255.76.67:7667?ttl=0";
  writeHilConfig(folder, schedule, options, devices);
  const ConfigTable table = ConfigTable::load(folder.config());
  EXPECT_EQ(table.table("slam").integer("features", 0, 0, 1000), 400);
  EXPECT_EQ(table.table("cameras").text("left", ""), "FTH-L");
  EXPECT_EQ(table.table("cameras").integer("width", 0, 0, 10000), 136);
  EXPECT_EQ(table.table("dvl").text("device", ""), devices.dvl);
  EXPECT_FALSE(table.has("modem"));

  write(temporary.path() / "base.toml", "[dvl]\ndevice = \"serial:/dev/ttyS0:9600\"\n");
  EXPECT_THROW(writeHilConfig(folder, schedule, options, devices), InputError);
  writeHilMission(folder, schedule);
  EXPECT_EQ(io::readMissionConfig(folder.mission()).start_utc_ns, kMissionNs);
  std::ifstream played(folder.camera(CameraSide::kLeft, "txt"));
  std::string line;
  std::getline(played, line);
  EXPECT_EQ(line, "1.000000000,L10.tif");
}

}  // namespace
}  // namespace fathom::sim
