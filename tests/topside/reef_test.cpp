#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/calibration/sensor_checks.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/mission/control_maker.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/reef_quick.hpp"

namespace fathom::topside {
namespace {

TEST_F(ReefQuick, TheMapOfASimulatedDiveIsOnTheTrueSeafloor) {
  EXPECT_GE(done_.used, 28u);
  EXPECT_EQ(done_.unreadable, 0u);

  const Eigen::Vector3d shift = shiftToTruth(kReefMission, out_->path() / "topside", done_.pairs, 0.15);

  Mesh mesh = readPly(out_->path() / "topside" / "mesh.ply");
  const Mesh seafloor = readPly(kReefMission / "truth" / "terrain.ply");
  transform(mesh, SE3(Eigen::Quaterniond::Identity(), shift));
  const test::SurfaceDistance toSeafloor(seafloor, 0.25F);
  std::vector<float> errors;
  for (const auto& v : mesh.vertices) errors.push_back(toSeafloor(v));
  std::sort(errors.begin(), errors.end());
  const float median = errors[errors.size() / 2], p95 = errors[errors.size() * 95 / 100];
  std::printf("%zu vertices, %.1f m2: surface error median %.1f mm, 95 %% %.1f mm\n", mesh.vertices.size(),
              done_.area, 1e3 * static_cast<double>(median), 1e3 * static_cast<double>(p95));
  EXPECT_LT(median, 0.0134F);  // twice what was measured
  EXPECT_LT(p95, 0.041F);
  // mission.toml has no tide model: heights are unknown by half a metre, and every vertex says so.
  EXPECT_GT(*std::min_element(mesh.sigma.begin(), mesh.sigma.end()), 0.45F);
}

TEST_F(ReefQuick, TheSamePlaceHasTheSameColourInEveryImage) {
  const auto report = nlohmann::json::parse(test::readText(out_->path() / "topside" / "report.json"));
  EXPECT_EQ(report.at("lighting").at("white_balance"), "grey world");
  const auto& overlap = report.at("lighting").at("overlap");
  std::printf("%s\n", overlap.dump().c_str());
  EXPECT_GT(overlap.at("places").get<int>(), 1000);
  EXPECT_LT(overlap.at("luminance_after").get<double>(), 0.5 * overlap.at("luminance_before").get<double>());
  EXPECT_LT(overlap.at("luminance_after").get<double>(), 0.05);
  EXPECT_LT(overlap.at("chroma_after").get<double>(), 1.5);
}

TEST_F(ReefQuick, ImagesOfAnyNameWithGivenPosesMakeTheSameMap) {
  RunPlaces places = placesOf("posed");
  places.input.poses = out_->path() / "poses.data";
  io::writeStereoPoses(places.input.poses, poses_);
  const Summary posed = runTopside(places, {});
  EXPECT_EQ(posed.used, done_.used);
  EXPECT_NEAR(posed.area, done_.area, 0.02 * done_.area);
  EXPECT_THAT(test::readText(places.out / "images.json"), testing::HasSubstr("left/0.png"));
}

// Positions of the cameras, moved rigidly onto those of the truth: rms of what is left [m].
double alignedError(const io::StereoPoseFile& estimate, const io::StereoPoseFile& named) {
  const auto truth = io::readTrajectory(kReefMission / "truth" / "trajectory.csv");
  const SE3 T_body_cam = io::readMissionConfig(kReefMission).T_body_cam;
  std::map<std::string, double> utc_s;
  for (const io::StereoPose& pose : named.poses) utc_s[pose.left_image] = pose.utc_s;
  Eigen::Matrix3Xd from(3, estimate.poses.size()), to(3, estimate.poses.size());
  for (std::size_t k = 0; k < estimate.poses.size(); ++k) {
    const auto column = static_cast<Eigen::Index>(k);
    from.col(column) = estimate.poses[k].T_nav_cam.translation();
    to.col(column) = (truePoseAt(truth, utc_s.at(estimate.poses[k].left_image)) * T_body_cam).translation();
  }
  const Eigen::Matrix4d T = rigidAlignment(from, to);
  const Eigen::Matrix3Xd left =
      ((T.topLeftCorner<3, 3>() * from).colwise() + Eigen::Vector3d(T.topRightCorner<3, 1>())) - to;
  return std::sqrt(left.squaredNorm() / static_cast<double>(from.cols()));
}

TEST_F(ReefQuick, ImagesAloneGiveTheTrajectoryAsWellAsWithNavigation) {
  const RunPlaces places = placesOf("alone");
  const Summary alone = runTopside(places, {});
  EXPECT_EQ(alone.used, done_.used);
  EXPECT_NEAR(alone.area, done_.area, 0.05 * done_.area);
  const double navigated = alignedError(poses_, poses_),
               error = alignedError(io::readStereoPoses(places.out / "stereo_pose_est.data"), poses_);
  std::printf("cameras off the truth: %.1f mm with navigation, %.1f mm without\n", 1e3 * navigated,
              1e3 * error);
  EXPECT_LT(error, 0.0136);  // twice what was measured
}

// Positions of the cameras as they are: root mean square of what they are off [m].
double absoluteError(const io::StereoPoseFile& estimate, const io::StereoPoseFile& named) {
  const auto truth = io::readTrajectory(kReefMission / "truth" / "trajectory.csv");
  const SE3 T_body_cam = io::readMissionConfig(kReefMission).T_body_cam;
  double squares = 0;
  for (const io::StereoPose& pose : estimate.poses) {
    const auto same = std::find_if(named.poses.begin(), named.poses.end(),
                                   [&](const auto& other) { return other.left_image == pose.left_image; });
    squares += (pose.T_nav_cam.translation() - (truePoseAt(truth, same->utc_s) * T_body_cam).translation())
                   .squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(estimate.poses.size()));
}

// Images alone, through a calibration whose baseline is 0.6 % too short.
TEST_F(ReefQuick, ControlPointsAndScaleBarsPlaceTurnAndScaleWhatImagesJoin) {
  RunPlaces places = placesOf("held");
  StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
  constexpr double kShort = 1.006;
  rig.T_right_left = SE3(rig.T_right_left.rotation(), rig.T_right_left.translation() / kShort);
  places.input.calib = dive() / "short.calib";
  writeStereoCalib(places.input.calib, rig);
  places.input.control = out_->path() / "control";
  sim::ControlMakerOptions survey{.out = places.input.control, .checks = 8, .bars = 2};
  (void)sim::makeControl(kReefMission, survey);
  std::string marks = test::readText(survey.out / "marks.csv");
  const auto recorded = io::readStereoPoses(run().out / "stereo_pose_est.data");
  for (std::size_t k = 0; k < recorded.poses.size(); ++k)
    for (const auto name : {&io::StereoPose::left_image, &io::StereoPose::right_image}) {
      const std::string there = std::filesystem::path(recorded.poses[k].*name).filename().string();
      for (auto at = marks.find(there); at != std::string::npos; at = marks.find(there))
        marks.replace(at, there.size(), poses_.poses[k].*name);
    }
  test::writeText(survey.out / "marks.csv", marks);
  const Summary held = runTopside(places, {});
  const double error = absoluteError(io::readStereoPoses(places.out / "stereo_pose_est.data"), poses_);
  const nlohmann::json report = nlohmann::json::parse(test::readText(places.out / "report.json")),
                       control = report["localisation"]["control"];
  std::printf("cameras off the truth: %.1f mm; scale %.5f, sigma %.5f\n", 1e3 * error,
              control["scale"].get<double>(), control["scale_sigma"].get<double>());
  EXPECT_LT(error, 0.03);
  // The scale takes in what disparities of 14 px are off together, too.
  constexpr double kTogether = 0.03 / 14;
  EXPECT_NEAR(control["scale"].get<double>(), kShort,
              3 * std::hypot(control["scale_sigma"].get<double>(), kTogether));
  int far = 0, checks = 0;
  for (const auto& point : control["points"]) {
    if (point["use"] != "check") continue;
    for (int i = 0; i < 3; ++i, ++checks)
      far += std::abs(point["off_m"][i].get<double>()) > 2 * point["sigma_m"][i].get<double>() ? 1 : 0;
  }
  EXPECT_EQ(checks, 24);
  EXPECT_LE(far, 3) << control["points"];
  EXPECT_NEAR(held.area, done_.area, 0.05 * done_.area);
  EXPECT_THAT(held.to_know, testing::Contains(testing::HasSubstr("check points are")));
  EXPECT_THAT(test::readText(places.out / "report.html"), testing::HasSubstr("sigma north [mm]"));

  RunPlaces reckoned{kReefMission, out_->path() / "reckoned.work", out_->path() / "reckoned", {}};
  reckoned.input.control = survey.out;
  TopsideConfig config;
  config.slam = false;
  EXPECT_THAT(test::refusal([&] { (void)runTopside(reckoned, config); }), testing::HasSubstr("--no-slam"));
}

// A rig knocked by 0.2 degrees, and focal lengths 0.3 % off.
TEST_F(ReefQuick, ARigThatHasMovedSinceItWasCalibratedGivesTheSameMap) {
  const std::filesystem::path mission = out_->path() / "knocked";
  std::filesystem::create_directories(mission);
  for (const char* name : {"img", "mission.toml", "sensors.lcmlog"})
    std::filesystem::create_symlink(kReefMission / name, mission / name);
  StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
  constexpr double kTurned = degreesToRadians(0.2);
  writeStereoCalib(mission / "stereo.calib", calibration::changed(rig, {{kTurned, 0, 0}, 0.006, 0}));
  const Summary knocked = runTopside(mission, mission / "topside", {});
  EXPECT_EQ(knocked.used, done_.used);
  EXPECT_NEAR(knocked.area, done_.area, 0.03 * done_.area);
  const auto errorOf = [](const std::filesystem::path& results) {
    const io::StereoPoseFile found = io::readStereoPoses(results / "stereo_pose_est.data");
    return alignedError(found, found);
  };
  TopsideConfig as_given;
  as_given.mend_rig = false;
  (void)runTopside(mission, mission / "given", as_given);
  const double right = alignedError(poses_, poses_), corrected = errorOf(mission / "topside"),
               given = errorOf(mission / "given");
  std::printf("cameras off the truth: %.1f mm as calibrated, %.1f mm knocked; as given %.1f mm\n",
              1e3 * right, 1e3 * corrected, 1e3 * given);
  EXPECT_LT(corrected, 2 * right);
  EXPECT_GT(given, 2 * corrected);
  const nlohmann::json report = nlohmann::json::parse(test::readText(mission / "topside" / "report.json"));
  EXPECT_TRUE(report["rig"]["mended"].get<bool>());
  EXPECT_NEAR(report["rig"]["right_turned_deg"][0].get<double>(), -0.2, 0.01);
  EXPECT_NEAR(report["rig"]["right_focal_longer"].get<double>(), -0.006, 0.0006);
}

// Without the pairs from `cut` on, before `resume`: two lists of times as --pairs wants them.
std::string pairsWithout(const io::StereoPoseFile& poses, std::size_t cut, std::size_t resume) {
  std::string text = "left,right,utc\n";
  for (std::size_t k = 0; k < poses.poses.size(); ++k)
    if (k < cut || k >= resume)
      text += poses.poses[k].left_image + "," + poses.poses[k].right_image + "," +
              formatted("%.6f", poses.poses[k].utc_s) + "\n";
  return text;
}

TEST_F(ReefQuick, NavigationFromATablePlacesWhatImagesJoin) {
  RunPlaces places = placesOf("tabled");
  const std::filesystem::path nav = dive() / "nav.csv", pairs = dive() / "pairs.csv";
  const auto truth = io::readTrajectory(kReefMission / "truth" / "trajectory.csv");
  std::string table = "time,north,east,depth,roll,pitch,heading\n";
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  constexpr std::size_t kEvery = 25;  // of 50 rows a second
  for (std::size_t k = 0; k < truth.size(); k += kEvery) {
    const Eigen::Vector3d p = truth[k].pose.translation(), angles = truth[k].pose.euler() * kDegreesPerRadian;
    table += formatted("%.3f,%.3f,%.3f,%.3f,%.2f,%.2f,%.2f\n", static_cast<double>(truth[k].utc_ns) * 1e-9,
                       p.x() + 0.2 * normal(random), p.y() + 0.2 * normal(random),
                       p.z() + 0.02 * normal(random), angles.x() + 0.5 * normal(random),
                       angles.y() + 0.5 * normal(random), angles.z() + 2 * normal(random));
  }
  test::writeText(nav, table);
  test::writeText(pairs, pairsWithout(poses_, 10, 14));
  places.input.files.pairs = pairs;
  places.input.nav.files = {nav};
  places.input.nav.sigma = 0.2;
  const SE3 T_cam_body = io::readMissionConfig(kReefMission).T_body_cam.inverse();
  const SE3 mount = T_cam_body.inverse() * SE3::fromEuler(0, 0, -std::numbers::pi / 2, {0, 0, 0});
  const Eigen::Vector3d turn = mount.euler() * kDegreesPerRadian, place = mount.translation();
  places.input.mount = {turn.x(), turn.y(), turn.z(), place.x(), place.y(), place.z()};
  (void)runTopside(places, {});
  const auto found = io::readStereoPoses(places.out / "stereo_pose_est.data").poses;
  EXPECT_EQ(found.size(), poses_.poses.size() - 4);
  double worst = 0, squares = 0;
  for (const io::StereoPose& pose : found) {
    const double error =
        ((pose.T_nav_cam * T_cam_body).translation() - truePoseAt(truth, pose.utc_s).translation()).norm();
    worst = std::max(worst, error);
    squares += error * error;
  }
  const double rms = std::sqrt(squares / static_cast<double>(found.size()));
  std::printf("cameras where they are: rms %.0f mm, at most %.0f mm\n", 1e3 * rms, 1e3 * worst);
  EXPECT_LT(rms, 0.15);  // twice what was measured
  EXPECT_THAT(test::readText(places.out / "report.json"), testing::HasSubstr("\"navigation file\""));
}

}  // namespace
}  // namespace fathom::topside
