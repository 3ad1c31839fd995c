#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <fstream>

#include "realtime/base/input_error.hpp"
#include "sim/hil/bench/child_process.hpp"
#include "sim/hil/bench/machine_faults.hpp"
#include "sim/hil/bench/program_under_test.hpp"
#include "sim/hil/bench/recording_disk.hpp"
#include "sim/hil/bench/stepped_clock.hpp"
#include "tests/sim/hil_mission.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

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
  ScheduleOptions options;
  options.start_utc_ns = kMissionNs;
  const MissionSchedule schedule = makeSchedule(folder.path() / "mission", options);
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

}  // namespace
}  // namespace fathom::sim
