#include "recon/topside/input/navigation.hpp"
#include "realtime/base/units.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <random>

#include "firmware_if/mission/sensor_log.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/navigation_inputs.hpp"
#include "recon/topside/prepare/rig_finding.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/rigs.hpp"

namespace fathom::topside {
namespace {

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;  // [ns]
constexpr double kTrackDepth = 20, kSpeed = 0.5;            // [m], northwards [m/s]

std::int64_t at(double seconds) {
  return kStart + std::llround(seconds * 1e9);
}

// A level dive northwards with bottom track in [from, to) and again from `again` on, and whatever fixes.
struct MadeDive {
  double end = 200, from = 0, to = 1e9, again = 1e9;
  double tide = 0;  // amplitude [m], of half an hour's period
  std::vector<double> usbl{}, gps{};
  double late = 0;  // samples arrive up to so late, each by another time [s]

  [[nodiscard]] io::MissionConfig mission() const {
    io::MissionConfig config;
    config.vehicle_name = "made";
    config.origin = {-0.5, 2.0};
    config.start_utc_ns = kStart;
    if (tide > 0)
      config.tide_model = "sinusoid amplitude_m=" + std::to_string(tide) + " period_s=1800 phase_rad=0.5";
    return config;
  }
  void write(const std::filesystem::path& folder) const {
    io::writeMissionConfig(folder, mission());
    std::mt19937 random(7);
    std::multimap<std::int64_t, SensorSample> log;
    const auto arrives = [&](double t, const SensorSample& sample) {
      log.emplace(at(t + late * static_cast<double>(random()) / std::mt19937::max()), sample);
    };
    const LocalTransverseMercator projection(mission().origin);
    for (int tick = 0; tick < static_cast<int>(end * 5); ++tick) {
      const double t = 0.2 * tick;
      arrives(t, AttitudeSample{.utc_ns = at(t), .magnetic = false});
      const double sea = tide * std::sin(2 * M_PI * t / 1800 + 0.5);
      arrives(t, DepthSample{at(t), kTrackDepth + sea});
      const Geodetic g = projection.toGeodetic({kSpeed * t, 0});
      if (tick % 5 == 0) {
        for (const double when : usbl)
          if (std::abs(when - t) < 0.1) arrives(t, UsblFix{at(t), at(t), g.latitude, g.longitude, 0, 1.0});
        for (const double when : gps)
          if (std::abs(when - t) < 0.1) arrives(t, GpsFix{at(t), g.latitude, g.longitude, 2.0});
      }
      if (t < from || (t >= to && t < again)) continue;
      DvlSample dvl;
      dvl.utc_ns = at(t);
      dvl.velocity = Eigen::Vector3d(kSpeed, 0, 0);
      dvl.altitude = 2;
      arrives(t, dvl);
    }
    io::SensorLogWriter writer(io::MissionPaths(folder).log());
    for (const auto& [arrival, sample] : log) writer.write(arrival, sample);
  }
  [[nodiscard]] Navigation navigated(const std::vector<double>& images) const {
    const test::TemporaryFolder folder;
    write(folder.path());
    std::vector<std::int64_t> times;
    for (const double t : images) times.push_back(at(t));
    return navigate(io::MissionPaths(folder.path()), mission(), {}, times);
  }
};

const FixSeen* seenAt(const Navigation& navigation, double seconds) {
  for (const FixSeen& fix : navigation.fixes)
    if (fix.utc_ns == at(seconds)) return &fix;
  return nullptr;
}

TEST(NavigationFixes, OfADescentAreAsWrongAsTheVehicleMayHaveDriftedUntilBottomTrack) {
  const MadeDive dive{.from = 100, .usbl = {10, 90, 150}};
  const Navigation navigation = dive.navigated({105, 110, 190});
  const double drift = TopsideConfig{}.navigation.noise.unknown_velocity;
  for (const double t : dive.usbl) ASSERT_NE(seenAt(navigation, t), nullptr) << t;
  EXPECT_NEAR(seenAt(navigation, 10)->sigma, std::hypot(1, 90 * drift), 1e-6);
  EXPECT_NEAR(seenAt(navigation, 90)->sigma, std::hypot(1, 10 * drift), 1e-6);
  EXPECT_NEAR(seenAt(navigation, 150)->sigma, 1, 1e-9);
}

TEST(NavigationFixes, GpsOfAVehicleThatComesUpDuringTheDiveIsOneFixAMinuteWithTheDriftOfTheAscent) {
  const MadeDive dive{.end = 400, .to = 100, .again = 300, .gps = {5, 150, 160, 170, 215}};
  const Navigation navigation = dive.navigated({20, 90, 320, 390});
  const double drift = TopsideConfig{}.navigation.noise.unknown_velocity;
  ASSERT_NE(seenAt(navigation, 150), nullptr);
  EXPECT_EQ(seenAt(navigation, 150)->kind, nav::FixKind::kGps);
  EXPECT_NEAR(seenAt(navigation, 150)->sigma, std::hypot(2, drift * (150 - 99.8)), 1e-3);
  EXPECT_EQ(seenAt(navigation, 160), nullptr);
  EXPECT_NE(seenAt(navigation, 215), nullptr);
  ASSERT_NE(seenAt(navigation, 5), nullptr);
  EXPECT_NEAR(seenAt(navigation, 5)->sigma, 2, 1e-9);
  EXPECT_EQ(navigation.anchor.source, "gps");
}

TEST(NavigationFixes, GpsDuringTheDiveAnchorsADiveThatHadNoneBefore) {
  MadeDive dive{.gps = {150}};
  EXPECT_EQ(dive.navigated({20, 90}).anchor.source, "gps");
  dive.gps = {};
  EXPECT_EQ(dive.navigated({20, 90}).anchor.source, "none");
}

TEST(NavigationFixes, GpsBeforeALaunchWithoutBottomIsAsWrongAsTheVehicleMayHaveDriftedUntilTheFirstImage) {
  const double drift = TopsideConfig{}.navigation.noise.unknown_velocity;
  MadeDive dive;
  dive.end = 230;
  for (int t = 0; t < 20; ++t) dive.gps.push_back(t);
  dive.from = 220;
  const Navigation unlocked = dive.navigated({222, 228});
  ASSERT_TRUE(unlocked.gps_shift);
  EXPECT_NEAR(unlocked.gps_sigma, std::hypot(2, drift * (220 - 19)), 0.1);
  // The same where bottom track was there for a second at the surface.
  dive.from = 0;
  dive.to = 1;
  dive.again = 220;
  const Navigation lost = dive.navigated({222, 228});
  ASSERT_TRUE(lost.gps_shift);
  EXPECT_NEAR(lost.gps_sigma, std::hypot(2, drift * (220 - 19)), 1.0);
}

TEST(NavigationOrder, IsThatOfTheStampsHoweverLateSamplesArrive) {
  MadeDive dive{.from = 10.1, .to = 90.1, .again = 97.1, .usbl = {50, 150}};
  const Navigation prompt = dive.navigated({30, 95, 120, 190});
  dive.late = 3;
  const Navigation late = dive.navigated({30, 95, 120, 190});
  EXPECT_EQ(late.counters.out_of_order, prompt.counters.out_of_order);
  ASSERT_EQ(late.poses.size(), prompt.poses.size());
  for (std::size_t k = 0; k < late.poses.size(); ++k) {
    ASSERT_TRUE(late.poses[k].T_nav_body);
    EXPECT_LT((late.poses[k].T_nav_body->inverse() * *prompt.poses[k].T_nav_body).log().norm(), 1e-9) << k;
  }
}

TEST(NavigationTide, IsTakenOutOfTheDepth) {
  const MadeDive dive{.tide = 1.5};
  const Navigation navigation = dive.navigated({50, 120, 190});
  for (const NavigatedPose& pose : navigation.poses) {
    ASSERT_TRUE(pose.T_nav_body);
    EXPECT_NEAR(pose.T_nav_body->translation().z(), kTrackDepth, 0.005);
  }
}

TEST(Survey, OnlyACameraThatLooksAsideHasItsRangesFromTheImages) {
  MissionInput input;
  const auto beside = [&](double degrees) {
    input.mission.T_body_cam = SE3::fromEuler(degreesToRadians(degrees), 0, M_PI / 2, {0, 0, 0});
    return seesBeside(input);
  };
  EXPECT_FALSE(beside(0));
  EXPECT_FALSE(beside(45));
  EXPECT_TRUE(beside(60));
  EXPECT_TRUE(beside(90));
  input.features_only = true;
  EXPECT_FALSE(beside(90));
}

// At half a metre a second, accelerating by 5 cm/s2, without a DVL; images measure all steps but two.
TEST(Bridge, StepsThatNothingMeasuresGetTheVelocityOfTheImagesAboutThem) {
  constexpr double kEvery = 0.5, kUnknown = 0.3;  // [s], [m/s]
  const auto north = [](std::size_t k) {
    const double t = kEvery * static_cast<double>(k);
    return kSpeed * t + 0.5 * 0.05 * t * t;
  };
  std::vector<slam::KeyframeInput> inputs(13);
  std::vector<slam::NavigationLink> links;
  for (std::size_t k = 0; k < inputs.size(); ++k) {
    inputs[k].utc_ns = at(kEvery * static_cast<double>(k));
    inputs[k].T_odom_cam = SE3(Eigen::Quaterniond::Identity(), {0, 0, kTrackDepth});  // as if it stood still
    inputs[k].unlocked_s = k == 0 ? 0 : kEvery;
    if (k == 0 || k == 5 || k == 9) continue;
    slam::NavigationLink& link = links.emplace_back();
    link.a = static_cast<std::uint32_t>(k - 1);
    link.b = static_cast<std::uint32_t>(k);
    link.T_a_b = SE3(Eigen::Quaterniond::Identity(), {north(k) - north(k - 1), 0, 0});
  }
  std::vector<slam::NavigationFix> fixes(1);
  fixes[0].frame = 12;
  EXPECT_EQ(unjoined(inputs, links, kUnknown).size(), 8U) << "the first five are the largest group";
  bridge(inputs, fixes, links, kUnknown);
  for (const std::size_t k : {5U, 9U}) {
    const Eigen::Vector3d moved = inputs[k].T_odom_cam.translation() - inputs[k - 1].T_odom_cam.translation();
    EXPECT_NEAR(moved.x(), north(k) - north(k - 1), 1e-6);
    EXPECT_LT(kUnknown * inputs[k].unlocked_s, 0.02);
  }
  EXPECT_EQ(inputs[3].unlocked_s, kEvery);
  EXPECT_NEAR(fixes[0].antenna_in_odom.x(), north(5) - north(4) + north(9) - north(8), 1e-6);
  EXPECT_TRUE(unjoined(inputs, links, kUnknown).empty());
}

// Of forty steps of 0.25 m whose images are too long by so much, after a check of the rig that left 0.8 %.
ImageScale scaleOfSteps(double too_long) {
  constexpr std::size_t kExposures = 41;
  constexpr double kEvery = 0.5;  // [s]
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.01);
  TopsideConfig config;
  config.navigation.rig.scale = 0.008;
  config.navigation.rig.principal_point = config.navigation.rig.turn = 0;
  Frames frames;
  Navigation navigation;
  std::vector<slam::NavigationLink> links;
  for (std::size_t k = 0; k < kExposures; ++k) {
    const double t = kEvery * static_cast<double>(k);
    frames.pair.push_back(static_cast<std::uint32_t>(k));
    frames.reckoned.emplace_back(Eigen::Quaterniond::Identity(), Eigen::Vector3d(kSpeed * t, 0, kTrackDepth));
    frames.range.push_back(2);
    frames.false_bottom.push_back(false);
    navigation.poses.emplace_back().utc_ns = at(t);
    if (k == 0) continue;
    slam::NavigationLink& link = links.emplace_back();
    link.a = static_cast<std::uint32_t>(k - 1);
    link.b = static_cast<std::uint32_t>(k);
    link.T_a_b =
        SE3(Eigen::Quaterniond::Identity(), {(1 + too_long) * (kSpeed * kEvery) * (1 + noise(random)), 0, 0});
    link.covariance = 1e-6 * Matrix6d::Identity();
  }
  return imageScaleOf({}, config, navigation, frames, links);
}

TEST(ImageScaleOfSteps, IsSoughtAfterACheckOfTheRigWhereAllStepsContradictIt) {
  EXPECT_EQ(scaleOfSteps(0.015).sigma, 0);
  const ImageScale found = scaleOfSteps(0.05);
  EXPECT_EQ(found.steps, 40);
  EXPECT_NEAR(found.scale * 1.05, 1, 2 * found.sigma);
  EXPECT_LT(found.sigma, 0.004);
}

// Their errors too: across the ray and along it.
TEST(RetriangulatedFeature, IsAsTheOtherRigWouldHaveSeenIt) {
  const StereoRig truth = test::syntheticRig();
  const StereoRig nominal = calibration::withoutRangeError(truth, {0.01, 0.2});
  const Eigen::Vector3d seafloor(0.3, -0.2, 2);
  const auto seenBy = [&](const StereoRig& rig, const Eigen::Vector2d& left, double disparity) {
    Eigen::Vector3d out;
    double gap = 0;
    const Eigen::Vector2d right = truth.right.project(truth.T_right_left * seafloor);
    EXPECT_TRUE(triangulatePixels(rig, truth.left.project(seafloor) + left,
                                  right + left + Eigen::Vector2d(disparity, 0), out, gap));
    return out;
  };
  // By errors of a pixel's place, across and down, and of its disparity.
  const auto covarianceBy = [&](const StereoRig& rig) {
    constexpr double kOff = 0.1;
    Eigen::Matrix3d J;
    J << seenBy(rig, {kOff, 0}, 0), seenBy(rig, {0, kOff}, 0), seenBy(rig, {0, 0}, kOff);
    J.colwise() -= seenBy(rig, {0, 0}, 0);
    return Eigen::Matrix3d(J * J.transpose());
  };
  closure::FrameFeatures features;
  closure::Feature& feature = features.features.emplace_back();
  feature.point = seenBy(nominal, {0, 0}, 0).cast<float>();
  feature.covariance = closure::upperTriangle(covarianceBy(nominal).cast<float>());
  EXPECT_GT((feature.point.cast<double>() - seafloor).norm(), 0.3);
  retriangulate(nominal, truth, features);
  EXPECT_LT((feature.point.cast<double>() - seafloor).norm(), 4e-5);
  const Eigen::Matrix3d expected = covarianceBy(truth);
  EXPECT_LT((feature.covarianceMatrix() - expected).norm(), 0.02 * expected.norm());
}

TEST(StepsOfSeafloor, LeaveOutALayerWhosePathsFitItsAltitude) {
  std::vector<CameraOverDvl> steps(7, {0.05, -0.09});  // ranges 7 % too short, by relief or the rig
  steps[3] = {-0.85, -0.04};                           // a link that is none
  steps[5].path = -INFINITY, steps[6] = {0, -INFINITY};
  const std::vector<bool> all = {true, true, true, false, true, false, false};
  EXPECT_EQ(areOfSeafloor(steps), all);
  // Three more over a layer at half the range that goes along at half the speed.
  steps.insert(steps.end(), 3, {0.6, 0.63});
  std::vector<bool> of_seafloor = areOfSeafloor(steps);
  EXPECT_EQ(std::count(of_seafloor.begin() + 7, of_seafloor.end(), true), 0);
  of_seafloor.resize(7);
  EXPECT_EQ(of_seafloor, all);
  // What all steps say is the rig's.
  std::vector<CameraOverDvl> turned(4, {0.6, 0.63});
  EXPECT_EQ(areOfSeafloor(turned), std::vector<bool>(4, true));
  // In a long dive most steps are not looked at.
  turned.resize(40);
  of_seafloor = areOfSeafloor(turned);
  EXPECT_EQ(std::count(of_seafloor.begin(), of_seafloor.end(), true), 4);
}

}  // namespace
}  // namespace fathom::topside
