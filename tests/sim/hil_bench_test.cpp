#include <gmock/gmock.h>
#include <signal.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/config_table.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "sim/hil/bench/child_process.hpp"
#include "sim/hil/bench/machine_faults.hpp"
#include "sim/hil/bench/program_under_test.hpp"
#include "sim/hil/fault_table.hpp"
#include "sim/hil/hil_compare.hpp"
#include "sim/hil/hil_folder.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/missions.hpp"

namespace fathom::sim {
namespace {

TEST(ChildProcess, ItsOutputItsVariablesAndItsExitStatusAreSeen) {
  const test::TemporaryFolder folder;
  ChildProcess::Options options;
  options.argv = {"/bin/sh", "-c", "echo first; echo armed $WORD; exit 3"};
  options.environment = {"WORD=a=b"};
  options.output = folder.path() / "log";
  ChildProcess child(options);
  EXPECT_TRUE(child.waitForLine("armed", 10, kNeverStop));
  EXPECT_EQ(child.wait(10), 3);
  EXPECT_EQ(test::readText(options.output), "first\narmed a=b\n");
  EXPECT_FALSE(child.waitForLine("never", 10, kNeverStop)) << "ended: there is nothing to wait for";

  options.argv = {folder.path() / "absent"};
  ChildProcess absent(options);
  EXPECT_EQ(absent.wait(10), 126);
}

TEST(ChildProcess, ARunningProgramIsKilledBySignalAndEndsWithItsOwner) {
  const test::TemporaryFolder folder;
  ChildProcess::Options options;
  options.argv = {"/bin/sleep", "1000"};
  options.output = folder.path() / "log";
  pid_t pid = 0;
  {
    ChildProcess child(options);
    pid = child.pid();
    EXPECT_FALSE(child.wait(0).has_value());
    child.signal(SIGKILL);
    EXPECT_EQ(child.wait(10), 128 + SIGKILL);
  }
  {
    ChildProcess child(options);
    pid = child.pid();
  }
  EXPECT_NE(::kill(pid, 0), 0) << "ended with its owner";
}

TEST(ChildProcess, ANetworkOfItsOwnIsJoinedByACableOfLargePackets) {
  if (::geteuid() != 0) GTEST_SKIP() << "network namespaces need root";
  const test::TemporaryFolder folder;
  // The bench's own network is that of one more process, so that this test leaves the others theirs.
  const pid_t bench = ::fork();
  if (bench == 0) {
    if (!enterOwnNetwork().empty()) ::_exit(77);
    const Cable cable(1);
    ChildProcess::Options options;
    options.argv = {"/bin/sh", "-c", "ip -o addr show eth0; ip link show eth0"};
    options.output = folder.path() / "log";
    options.cable = cable;
    ChildProcess child(options);
    const bool joined = child.wait(10) == 0;
    const std::string text = test::readText(options.output);
    ::_exit(joined && text.find(cable.farAddress()) != std::string::npos &&
                    text.find("mtu 9000") != std::string::npos
                ? 0
                : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(bench, &status, 0), bench);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 77) GTEST_SKIP() << "no network namespaces here";
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << test::readText(folder.path() / "log");
}

TEST(ProgramUnderTest, KilledItLivesAgainAndEndedByItselfItDoesNot) {
  const test::TemporaryFolder folder;
  rt::RealClock real;
  const SimulatedVehicleClock clock(real);
  ChildProcess::Options options;
  options.argv = {"/bin/sh", "-c", "sleep 60 & echo armed; wait; exit 3"};
  options.output = folder.path() / "onboard.log";
  ProgramUnderTest program(options, clock);
  using Process = ProgramUnderTest::Process;
  ASSERT_TRUE(program.waitUntilArmed(10, kNeverStop));
  EXPECT_TRUE(program.running());
  EXPECT_TRUE(program.outages().empty());
  const auto soon = [&](auto holds) {
    for (int k = 0; k < 200; ++k) {
      if (holds()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return false;
  };
  ASSERT_TRUE(program.signalProcess(Process::kVehicle, SIGKILL));
  EXPECT_TRUE(soon([&] { return program.running() && program.outages().back().until_utc_ns > 0; }));
  ASSERT_EQ(program.outages().size(), 1u);
  EXPECT_LT(program.outages()[0].from_utc_ns, program.outages()[0].until_utc_ns);
  EXPECT_EQ(test::readText(folder.path() / "onboard-2.log"), "armed\n");
  // Its child; with which this one ends by itself.
  ASSERT_TRUE(soon([&] { return program.signalProcess(Process::kMapper, SIGKILL); }));
  EXPECT_TRUE(soon([&] { return !program.running(); }));
  EXPECT_EQ(program.wait(1), 3);
  EXPECT_FALSE(program.signalProcess(Process::kMapper, SIGKILL));
}

TEST(SteppedClock, AProgramSeesItsClockStepAndTheMachineDoesNot) {
  const test::TemporaryFolder folder;
  SteppedClock clock(folder.path() / "step");
  ASSERT_FALSE(clock.environment().empty())
      << "lib/fathom/libfathom_stepped_clock.so must be beside the tests' folder";
  const auto yearSeen = [&] {
    ChildProcess::Options options;
    options.argv = {"/bin/date", "+%s"};
    options.environment = clock.environment();
    options.output = folder.path() / "log";
    ChildProcess child(options);
    EXPECT_EQ(child.wait(10), 0);
    return std::stoll(test::readText(options.output));
  };
  const auto real = [] { return static_cast<long long>(::time(nullptr)); };
  EXPECT_NEAR(static_cast<double>(yearSeen() - real()), 0, 5);
  clock.step(86400);
  EXPECT_NEAR(static_cast<double>(yearSeen() - real()), 86400, 5);
  clock.step(-86400);
  EXPECT_NEAR(static_cast<double>(yearSeen() - real()), 0, 5);
}

TEST(RecordingDisk, FullIsFullAndWhatWasWrittenStays) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directories(folder.path() / "mission");
  // In a process of its own, with private mounts.
  const pid_t process = ::fork();
  if (process == 0) {
    RecordingDisk disk;
    if (!disk.open(folder.path() / "mission", 32ULL << 20, 32ULL << 20).empty()) ::_exit(77);
    const auto write = [&](const char* name, std::size_t bytes) {
      std::ofstream file(folder.path() / "mission" / name, std::ios::binary);
      file << std::string(bytes, 'x');
      file.close();
      return !file.fail();
    };
    bool good = write("before", 1 << 20);
    good = good && disk.fill(0) && !write("during", 1 << 20);
    disk.makeRoom();
    good = good && write("after", 1 << 20);
    disk.close();
    ::_exit(good ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(process, &status, 0), process);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 77) GTEST_SKIP() << "no mounts or loop devices here";
  ASSERT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  EXPECT_EQ(std::filesystem::file_size(folder.path() / "mission/before"), 1U << 20);
  EXPECT_EQ(std::filesystem::file_size(folder.path() / "mission/after"), 1U << 20);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "mission.disk"));
}

TEST(MachineFaults, EachIsDoneAtItsTimeAndTakenBackAndWhatCannotBeDoneIsSaid) {
  const test::TemporaryFolder folder;
  writeTenSecondMission(folder.path() / "mission");
  test::ManualClock time(kMissionNs);
  const MissionSchedule schedule = makeSchedule(folder.path() / "mission", {.start_utc_ns = kMissionNs});
  const FaultScript script = parseFaultScript(
      "[[fault]]\nkind = \"clock_step\"\nat_s = 2\nfor_s = 3\nstep_s = 60\n"
      "[[fault]]\nkind = \"cpu_hog\"\nat_s = 4\nfor_s = 100\nthreads = 1\n"
      "[[fault]]\nkind = \"disk_full\"\nat_s = 5\nfor_s = 1\n"
      "[[fault]]\nkind = \"cpu_hog\"\nat_s = 500\nfor_s = 1\n",
      "faults.toml");
  SimulatedVehicleClock clock(time);
  SteppedClock stepped(folder.path() / "step");
  MachineFaults machine(schedule, script, clock, nullptr, &stepped, nullptr);
  machine.run(kNeverStop);
  EXPECT_EQ(machine.done()[static_cast<std::size_t>(FaultKind::kClockStep)], 2U);
  EXPECT_EQ(machine.done()[static_cast<std::size_t>(FaultKind::kCpuHog)], 1U) << "the other is after the end";
  EXPECT_EQ(machine.done()[static_cast<std::size_t>(FaultKind::kDiskFull)], 0U);
  EXPECT_THAT(machine.notes(), testing::ElementsAre(testing::HasSubstr("disk_full was not done")));
}

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
    log.push_back({.mission_s = 0.5 * i,
                   .file = std::to_string(i),
                   .exposed_utc_ns = kMissionNs + i * period_ns + off_ns,
                   .fate = "sent"});
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
  const MissionSchedule schedule = makeSchedule(temporary.path() / "mission", {.start_utc_ns = kMissionNs});
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
