#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "recon/geometry/geodesy.hpp"

namespace fathom::onboard {
namespace {

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
      AttitudeSample attitude;
      attitude.utc_ns = at(t);
      attitude.magnetic = false;
      consume(system, t, attitude);
      consume(system, t, DepthSample{at(t), 1.0});
      if (t >= locked && (t < lost || t >= found)) {
        DvlSample dvl;
        dvl.utc_ns = at(t);
        dvl.velocity = Eigen::Vector3d(0.1, 0, 0);
        dvl.altitude = 2;
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
