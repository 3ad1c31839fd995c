#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/onboard/onboard_output.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "recon/geometry/geodesy.hpp"
#include "tests/support/disk_log.hpp"
#include "tests/support/full_disk.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

namespace fs = std::filesystem;

// Rows of second `t`.
void write(OnboardOutput& output, int from, int to) {
  for (int t = from; t < to; ++t) {
    const std::int64_t now = 1'800'000'000'000'000'000 + std::int64_t{t} * 1'000'000'000;
    output.addOdometry(now, SE3(Eigen::Quaterniond::Identity(), {0.1 * t, 1, 2}));
    MapOutput pair;
    pair.pair_index = static_cast<std::uint32_t>(t);
    pair.utc_ns = now;
    pair.keyframe = t / 3;
    pair.T_odom_cam = SE3(Eigen::Quaterniond::Identity(), {0.2 * t, 0, 2});
    output.addStereoPose(pair, "L" + std::to_string(t) + ".tif", "R" + std::to_string(t) + ".tif", 2.5);
    const std::array<std::uint8_t, 5> frame{1, 2, 3, 4, static_cast<std::uint8_t>(t)};
    output.addPacket(now, frame);
    if (t > 4) output.addDownlink(now, frame);
    output.addHealth(now, {{"pairs", t}, {"loss", 0.5 * t}});
  }
}

void finish(OnboardOutput& output) {
  output.placeStereoPoses([](const MapOutput& pair) { return pair.T_odom_cam; });
  output.writeText("report.json", "{}\n");
  output.commit();
}

std::map<std::string, std::string> contentOf(const fs::path& folder) {
  std::map<std::string, std::string> content;
  for (const auto& entry : fs::directory_iterator(folder))
    content[entry.path().filename().string()] = test::readText(entry.path());
  return content;
}

std::vector<std::uint8_t> stateOf(OnboardOutput& output) {
  std::vector<std::uint8_t> bytes(4096);
  rt::StateWriter writer(bytes);
  output.save(writer);
  bytes.resize(writer.size());
  return bytes;
}

constexpr OutputFolder::Life kLive{.outlives = true, .reopen = false},
    kAgain{.outlives = true, .reopen = true};

// Outputs in one folder, and one that nothing happened to.
class OnboardOutputs : public ::testing::Test {
 protected:
  [[nodiscard]] fs::path place(const std::string& name) const { return folder.path() / name; }
  void writeWhole(int rows) const {
    OnboardOutput whole(place("whole"), {});
    write(whole, 0, rows);
    finish(whole);
  }
  void expectWhole(const std::string& name) const {
    EXPECT_EQ(contentOf(place(name)), contentOf(place("whole")));
  }
  const test::TemporaryFolder folder;
};

TEST_F(OnboardOutputs, AFolderThatIsGoneOnWithAfterARestartIsTheOneOfOneRun) {
  writeWhole(20);
  for (const int saved_at : {0, 3, 12}) {
    const std::string name = "restarted" + std::to_string(saved_at);
    std::vector<std::uint8_t> state;
    {
      OnboardOutput first(place(name), {}, kLive);
      write(first, 0, saved_at);
      state = stateOf(first);
      write(first, saved_at, 15);  // done again after the restart
    }
    OnboardOutput second(place(name), {}, kAgain);
    rt::StateReader reader(state);
    ASSERT_TRUE(second.load(reader)) << reader.failure();
    write(second, saved_at, 20);
    finish(second);
    expectWhole(name);
  }
  EXPECT_TRUE(fs::exists(place("whole") / "downlink.bin"));
  EXPECT_FALSE(fs::exists(place("whole") / "pairs.tmp"));
}

TEST_F(OnboardOutputs, LoadingInTheMiddleOfARunCutsItsFilesBack) {
  writeWhole(20);
  OnboardOutput again(place("again"), {});
  write(again, 0, 4);
  const std::vector<std::uint8_t> state = stateOf(again);
  write(again, 4, 15);
  rt::StateReader reader(state);
  ASSERT_TRUE(again.load(reader)) << reader.failure();
  write(again, 4, 20);
  finish(again);
  expectWhole("again");
}

TEST_F(OnboardOutputs, FilesThatAreShorterThanTheyWereAreRefused) {
  std::vector<std::uint8_t> state;
  {
    OnboardOutput first(place("out"), {}, kLive);
    write(first, 0, 10);
    state = stateOf(first);
  }
  fs::resize_file(place("out.tmp") / "packets.bin", 10);
  OnboardOutput second(place("out"), {}, kAgain);
  rt::StateReader reader(state);
  EXPECT_FALSE(second.load(reader));
  EXPECT_STREQ(reader.failure(), "the output's files are shorter than they were");
}

TEST_F(OnboardOutputs, WithoutCommitNothingStaysUnlessItIsToOutliveItsProgram) {
  {
    OnboardOutput gone(place("gone"), {});
    OnboardOutput stays(place("stays"), {}, kLive);
    write(gone, 0, 3);
    write(stays, 0, 3);
  }
  EXPECT_FALSE(fs::exists(place("gone.tmp")));
  EXPECT_TRUE(fs::exists(place("stays.tmp")));
  OnboardOutput fresh(place("stays"), {}, kLive);
  write(fresh, 0, 2);
  finish(fresh);
  EXPECT_FALSE(fs::exists(place("stays.tmp")));
  std::ifstream rows(place("stays") / "health.csv");
  EXPECT_EQ(std::count(std::istreambuf_iterator<char>(rows), {}, '\n'), 3);
}

// Files of a few kilobytes, on a disk that takes no more than the first of them.
constexpr std::size_t kTaken = 3000;  // of every file [B]
constexpr int kFullFrom = 10, kFullTo = 300, kEnd = 320;

TEST_F(OnboardOutputs, ADiskThatIsFullForAWhileCostsNoRow) {
  writeWhole(kEnd);
  OnboardOutput late(place("late"), {});
  write(late, 0, kFullFrom);
  EXPECT_TRUE(late.readyToSave());
  {
    const test::FullDisk full(kTaken);
    write(late, kFullFrom, kFullTo);
    EXPECT_FALSE(late.readyToSave());
    EXPECT_FALSE(late.diskTakesData());
    EXPECT_NE(late.failure().find(": File too large"), std::string::npos) << late.failure();
  }
  EXPECT_FALSE(late.lost());
  EXPECT_TRUE(late.diskTakesData());
  EXPECT_EQ(late.failure(), "");
  EXPECT_TRUE(late.readyToSave());
  write(late, kFullTo, kEnd);
  finish(late);
  expectWhole("late");
}

TEST_F(OnboardOutputs, StateSavedWhileRowsWaitIsRefusedByTheNextProgram) {
  std::vector<std::uint8_t> state;
  {
    OnboardOutput first(place("out"), {}, kLive);
    const test::FullDisk full(kTaken);
    write(first, 0, kFullTo);
    state = stateOf(first);
  }
  OnboardOutput second(place("out"), {}, kAgain);
  rt::StateReader reader(state);
  EXPECT_FALSE(second.load(reader));
}

TEST_F(OnboardOutputs, RowsThatFitNoBufferAreLostAndOnlyEarlierStateMakesTheFolderWhole) {
  constexpr int kTooMany = 3000;
  writeWhole(kTooMany);
  OnboardOutput output(place("out"), {}, kLive);
  write(output, 0, kFullFrom);
  ASSERT_TRUE(output.readyToSave());
  const std::vector<std::uint8_t> before = stateOf(output);
  {
    const test::FullDisk full(kTaken);
    write(output, kFullFrom, kTooMany);
  }
  EXPECT_TRUE(output.lost());
  EXPECT_TRUE(output.diskTakesData());
  EXPECT_NE(output.failure().find("pairs.tmp"), std::string::npos) << output.failure();
  EXPECT_NE(output.failure().find("rows are lost"), std::string::npos) << output.failure();
  EXPECT_FALSE(output.readyToSave());
  EXPECT_THROW(finish(output), std::runtime_error);
  EXPECT_FALSE(fs::exists(place("out")));
  rt::StateReader reader(before);
  ASSERT_TRUE(output.load(reader)) << reader.failure();
  EXPECT_FALSE(output.lost());
  write(output, kFullFrom, kTooMany);
  finish(output);
  expectWhole("out");
}

TEST_F(OnboardOutputs, AFileThatCannotBeMadeYetTakesItsRowsLater) {
  writeWhole(20);
  OnboardOutput late(place("late"), {});
  const fs::path in_its_place = place("late.tmp") / "downlink.bin";
  fs::create_directory(in_its_place);
  write(late, 0, 10);
  EXPECT_FALSE(late.readyToSave());
  EXPECT_EQ(late.failure(), "downlink.bin: Is a directory");
  fs::remove(in_its_place);
  EXPECT_TRUE(late.readyToSave());
  write(late, 10, 20);
  finish(late);
  expectWhole("late");
}

TEST_F(OnboardOutputs, AMapThatCannotBeWrittenIsSaidByCommit) {
  OnboardOutput output(place("out"), {});
  write(output, 0, 5);
  fs::create_directory(place("out.tmp") / "map.ply.tmp");
  output.writeMap(Mesh());
  EXPECT_NE(output.failure().find("map.ply"), std::string::npos) << output.failure();
  EXPECT_THROW(finish(output), std::runtime_error);
  EXPECT_FALSE(fs::exists(place("out")));
}

TEST_F(OnboardOutputs, EveryFileIsOnTheDiskBeforeTheFolderHasItsName) {
  OnboardOutput output(place("out"), {});
  write(output, 0, 20);
  test::DiskLog log;
  finish(output);
  const fs::path growing = place("out.tmp");
  const std::ptrdiff_t named = log.renamed(growing, place("out"));
  ASSERT_GE(named, 0);
  for (const auto& [name, content] : contentOf(place("out"))) {
    EXPECT_GE(log.synced(growing / name), 0) << name;
    EXPECT_LT(log.synced(growing / name), named) << name;
  }
  EXPECT_GE(log.synced(growing), 0);
  EXPECT_LT(log.synced(growing), named);
  EXPECT_GT(log.synced(folder.path()), named);
}

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;  // [ns]
constexpr double kUnknownVelocity = 0.3;                    // default of SensorNoise [m/s]

std::int64_t at(double seconds) {
  return kStart + std::llround(seconds * 1e9);
}

// A vehicle that is launched at (120, -45) m in nav and drifts north at 0.1 m/s; GPS once a second until 20
// s, USBL every 10 s, bottom track from `locked` on, but for [lost, found).
struct Launch {
  double locked = 0, lost = 1e9, found = 1e9;
  double float_s = 20, usbl_from = 1e9;
  const Eigen::Vector2d where = {120, -45};
  io::MissionConfig mission;
  StereoRig rig;

  Launch() {
    mission.vehicle_name = "drifter";
    mission.origin = {-0.5, 2.0};
    mission.start_utc_ns = kStart;
    mission.T_body_usbl = SE3(Eigen::Quaterniond::Identity(), {0.5, 0.2, 0});
    for (Camera* camera : {&rig.left, &rig.right}) {
      camera->width = 64;
      camera->height = 48;
      camera->fx = camera->fy = 80;
      camera->cx = 32;
      camera->cy = 24;
    }
    rig.T_right_left = SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0});
  }
  [[nodiscard]] Eigen::Vector2d truth(double t) const { return where + Eigen::Vector2d(0.1 * t, 0); }
  [[nodiscard]] std::unique_ptr<OnboardSystem> system() const {
    OnboardConfig config;
    config.map.max_tiles = 64;
    config.localisation.enabled = false;
    return std::make_unique<OnboardSystem>(config, mission, rig, OnboardSystem::PairSource{});
  }
  void consume(OnboardSystem& system, double t, const SensorSample& sample) const {
    system.consume(at(t), sample, [](const auto&) {});
  }
  // Seconds [from, to) of the dive.
  void dive(OnboardSystem& system, double from, double to) const {
    const LocalTransverseMercator projection(mission.origin);
    for (int tick = static_cast<int>(from * 5); tick < static_cast<int>(to * 5); ++tick) {
      const double t = 0.2 * tick;
      consume(system, t, AttitudeSample{.utc_ns = at(t), .magnetic = false});
      consume(system, t, DepthSample{at(t), 1.0});
      if (t >= locked && (t < lost || t >= found)) {
        DvlSample dvl{.utc_ns = at(t), .velocity = Eigen::Vector3d(0.1, 0, 0), .range = {}, .altitude = 2};
        consume(system, t, dvl);
      }
      const auto seen = [&](const Eigen::Vector3d& lever) {
        return projection.toGeodetic(truth(t) + lever.head<2>());
      };
      if (tick % 5 == 0 && t < float_s) {
        const Geodetic g = seen(Eigen::Vector3d::Zero());
        consume(system, t, GpsFix{at(t), g.latitude, g.longitude, 2.0});
      }
      if (tick % 50 == 0 && t >= usbl_from) {
        const Geodetic g = seen(mission.T_body_usbl.translation());
        consume(system, t, UsblFix{at(t), at(t), g.latitude, g.longitude, 0, 1.0});
      }
    }
  }
  // Where the vehicle is taken to be at the end of the dive against where it is [m].
  [[nodiscard]] double error(const OnboardSystem& system, double t) const {
    const auto T_odom_body = system.nav().odometry().poseAt(at(t));
    return ((system.map().T_nav_odom() * *T_odom_body).translation().head<2>() - truth(t)).norm();
  }
};

TEST(OnboardFixes, OfAVehicleLaunchedWhereTheDvlSeesNoBottomAnchorItWithWhatItMayHaveDrifted) {
  Launch launch;
  launch.locked = 220;
  const auto system = launch.system();
  launch.dive(*system, 0, 230);
  ASSERT_TRUE(system->map().anchored());
  // The last fix is of 19 s; the vehicle drifted for 201 s at 0.1 m/s.
  const double sigma = std::hypot(2, kUnknownVelocity * 201);
  EXPECT_NEAR(system->map().anchorSigma(), sigma, 0.1);
  EXPECT_LT(launch.error(*system, 229), 22);
}

TEST(OnboardFixes, ByUsblDuringTheDescentGiveTheAnchorThatTheLastOfThemAllow) {
  Launch launch;
  launch.locked = 220;
  launch.usbl_from = 30;
  const auto system = launch.system();
  launch.dive(*system, 0, 219);
  EXPECT_FALSE(system->map().anchored());
  launch.dive(*system, 219, 222);
  ASSERT_TRUE(system->map().anchored());
  EXPECT_LT(launch.error(*system, 221), 0.5);
  EXPECT_LT(system->map().anchorSigma(), std::hypot(1.1, slam::SensorNoise().usbl_shift));
}

TEST(OnboardFixes, BottomTrackThatWasLostAgainAtTheSurfaceLeavesTheDriftInTheAnchorOfTheFirstPair) {
  Launch launch;
  launch.lost = 1;
  launch.found = 220;
  const auto system = launch.system();
  launch.dive(*system, 0, 230);
  ASSERT_TRUE(system->map().anchored());
  launch.usbl_from = 230;  // one fix, so that the anchor is asked for where the vehicle is now
  launch.dive(*system, 230, 230.4);
  EXPECT_LT(launch.error(*system, 230), 1.0);
  EXPECT_LT(system->map().anchorSigma(), std::hypot(1.1, slam::SensorNoise().usbl_shift));
}

TEST(OnboardFixes, ThatWaitForBottomTrackAreSavedState) {
  Launch launch;
  launch.locked = 220;
  const auto whole = launch.system(), first = launch.system(), second = launch.system();
  launch.dive(*whole, 0, 230);
  launch.dive(*first, 0, 100);
  std::vector<std::uint8_t> buffer(64 << 20);
  rt::StateWriter writer(buffer);
  first->save(writer);
  ASSERT_FALSE(writer.full());
  rt::StateReader reader(writer.written());
  ASSERT_TRUE(second->load(reader));
  launch.dive(*second, 100, 230);
  EXPECT_EQ(second->map().T_nav_odom().translation(), whole->map().T_nav_odom().translation());
  EXPECT_EQ(second->map().anchorSigma(), whole->map().anchorSigma());
}

}  // namespace
}  // namespace fathom::onboard
