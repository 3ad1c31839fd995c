#include "sim/score/score.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/score/surface_score.hpp"
#include "sim/score/truth_surface.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/ground.hpp"

namespace fathom::sim {
namespace {

constexpr std::int64_t kStart = 1772330400000000000;

// The vehicle flies north along one line and, forty seconds later, back south over it.
SE3 truePose(double time_s) {
  const double half = 20.0;
  const bool back = time_s > half;
  const double n = back ? 2.5 - 0.25 * (time_s - half) : -2.5 + 0.25 * time_s;
  return SE3::fromEuler(0.01 * std::sin(time_s), 0.02, back ? 3.1 : 0.05,
                        {n, back ? 0.3 : 0.0, 8.0 + 0.05 * std::sin(0.3 * time_s)});
}

class ScoreTest : public ::testing::Test {
 protected:
  ScoreTest() {
    config_.origin = {-0.4, 2.65};
    config_.start_utc_ns = kStart;
    config_.T_body_cam = SE3::fromEuler(0.01, -0.02, 1.58, {0.4, -0.03, 0.3});
    io::writeMissionConfig(root(), config_);
    StereoRig rig;
    rig.left = rig.right = {340, 256, 430, 430, 170, 128, 0.1, 0.3, 0, 0, 0};
    rig.T_right_left = SE3::fromEuler(0, 0, 0, {-0.07, 0, 0});
    writeStereoCalib(root() / "stereo.calib", rig);
    std::filesystem::create_directories(root() / "truth");
    writePly(root() / "truth" / "terrain.ply", test::syntheticSeafloor());
    std::vector<io::TrajectoryPoint> track;
    for (int i = -100; i <= 2100; ++i) track.push_back({kStart + i * 20'000'000LL, truePose(i * 0.02)});
    io::writeTrajectory(root() / "truth" / "trajectory.csv", track);
    std::ofstream images(root() / "truth" / "images.csv");
    images << "utc_ns,left_image,right_image\n";
    for (int i = 0; i <= 80; ++i)
      images << kStart + i * 500'000'000LL << ",L" << i << ".tif,R" << i << ".tif\n";
  }
  const std::filesystem::path& root() const { return folder_.path(); }

  SE3 trueCamera(int image) const { return truePose(image * 0.5) * config_.T_body_cam; }
  // Estimated poses of all images in the frame of `origin`.
  void writePoses(const std::string& program, const Geodetic& origin,
                  const std::function<SE3(int)>& cameraOf) {
    io::StereoPoseFile file;
    file.origin = origin;
    for (int i = 0; i <= 80; ++i) {
      file.poses.push_back({.id = i,
                            .utc_s = static_cast<double>(kStart) * 1e-9 + i * 0.5,
                            .T_nav_cam = cameraOf(i),
                            .left_image = "L" + std::to_string(i) + ".tif",
                            .right_image = "R" + std::to_string(i) + ".tif"});
    }
    std::filesystem::create_directories(root() / program);
    io::writeStereoPoses(root() / program / "stereo_pose_est.data", file);
  }
  // The true poses moved by T_nav_estimate; image `i` with its own further error.
  void writePoses(const std::string& program, const SE3& moved,
                  const std::function<Eigen::Vector3d(int)>& error = nullptr) {
    writePoses(program, config_.origin, [&](int i) {
      const SE3 camera = moved * trueCamera(i);
      return error ? SE3(camera.rotation(), camera.translation() + error(i)) : camera;
    });
  }
  void writeSurface(const std::string& program, const std::string& name, const SE3& moved) {
    Mesh mesh = test::syntheticSeafloor(0.08);
    transform(mesh, moved);
    std::filesystem::create_directories(root() / program);
    writePly(root() / program / name, mesh);
  }

  test::TemporaryFolder folder_;
  io::MissionConfig config_;
};

TEST_F(ScoreTest, APerfectEstimateHasNoError) {
  writePoses("onboard", SE3());
  std::filesystem::copy(root() / "truth" / "terrain.ply", root() / "onboard" / "map.ply");
  const ScoreReport report = scoreMission(root());
  ASSERT_TRUE(report.onboard && report.onboard_surface);
  EXPECT_LT(report.onboard->rms_m, 1e-5);
  EXPECT_LT(*report.onboard->aligned_rms_m, 1e-5);
  ASSERT_TRUE(report.onboard->crossover_rms_m);
  EXPECT_LT(*report.onboard->crossover_rms_m, 1e-5);
  EXPECT_LT(report.onboard_surface->rms_m, 1e-6);
  EXPECT_LT(report.onboard_surface->p99_m, 1e-6);
  EXPECT_GT(report.onboard_surface->coverage, 0.999);
  EXPECT_FALSE(report.topside || report.topside_surface);
}

TEST_F(ScoreTest, AKnownShiftIsTheAbsoluteErrorAndVanishesWhenAligned) {
  const SE3 shift(Eigen::Quaterniond::Identity(), {0.30, -0.20, 0.10});
  writePoses("topside", shift);
  writeSurface("topside", "mesh.ply", shift);
  const ScoreReport report = scoreMission(root());
  EXPECT_NEAR(report.topside->rms_m, std::sqrt(0.09 + 0.04 + 0.01), 1e-5);
  EXPECT_LT(*report.topside->aligned_rms_m, 1e-5);
  EXPECT_LT(*report.topside->crossover_rms_m, 1e-5) << "relative positions are right";
  EXPECT_GT(report.topside_surface->rms_m, 0.08);
  EXPECT_LT(report.topside_surface->aligned_rms_m, 0.003) << "what remains is the coarser lattice";
  EXPECT_GT(report.topside_surface->coverage, 0.97);
  EXPECT_GT(report.topside_surface->completeness, 0.97);
  const Eigen::Vector3d back = report.topside_surface->alignment * Eigen::Vector3d(0.30, -0.20, 0.10);
  EXPECT_LT(back.norm(), 0.01) << "the motion that was found takes the shift back";
  EXPECT_LT(std::abs(report.topside_surface->aligned_bias_m), 0.002);
}

TEST_F(ScoreTest, ASurfaceWithAHoleIsIncompleteByWhatIsMissing) {
  writePoses("topside", SE3());
  Mesh mesh = test::syntheticSeafloor(0.08);
  // The southern half of what there is.
  std::erase_if(mesh.triangles, [&](const auto& t) { return mesh.vertices[t[0]].x() < 0; });
  std::filesystem::create_directories(root() / "topside");
  writePly(root() / "topside" / "mesh.ply", mesh);
  const ScoreReport report = scoreMission(root());
  EXPECT_LT(report.topside_surface->rms_m, 0.003);
  EXPECT_LT(report.topside_surface->completeness, 0.8);
  EXPECT_GT(report.topside_surface->completeness, 0.2);
  EXPECT_NEAR(report.topside_surface->completeness, report.topside_surface->coverage, 0.1);
}

TEST_F(ScoreTest, AKnownTurnVanishesWhenAligned) {
  const SE3 turn = SE3::fromEuler(0.01, -0.015, 0.08, {0.2, 0.1, -0.05});
  writePoses("topside", turn);
  writeSurface("topside", "mesh.ply", turn);
  const ScoreReport report = scoreMission(root());
  EXPECT_GT(report.topside->rms_m, 0.1);
  EXPECT_LT(*report.topside->aligned_rms_m, 1e-5);
  EXPECT_GT(report.topside_surface->rms_m, 0.04);
  EXPECT_LT(report.topside_surface->aligned_rms_m, 0.003);
}

TEST_F(ScoreTest, FurtherSurfacesAreScoredFromThePipelinesAlignment) {
  const SE3 shift(Eigen::Quaterniond::Identity(), {0.30, -0.20, 0.10});
  writePoses("topside", shift);
  writeSurface("topside", "level_1.ply", shift);
  const auto file = root() / "topside" / "level_1.ply";
  const ScoreReport report = scoreMission(root(), {file});
  ASSERT_EQ(report.surfaces.size(), 1U);
  EXPECT_EQ(report.surfaces[0].first, file.string());
  EXPECT_LT(report.surfaces[0].second.aligned_rms_m, 0.003);
  EXPECT_THROW(static_cast<void>(scoreMission(root(), {root() / "absent.ply"})), InputError);
}

TEST_F(ScoreTest, ASurfaceAboveTheTruthHasAPositiveBias) {
  const SE3 up(Eigen::Quaterniond::Identity(), {0, 0, -0.05});
  writeSurface("onboard", "map.ply", up);
  const ScoreReport report = scoreMission(root());
  ASSERT_TRUE(report.onboard_surface);
  const SurfaceScore high = *report.onboard_surface;
  EXPECT_NEAR(high.bias_m, 0.048, 0.003) << "distances are square to slopes, a little below 5 cm";
  EXPECT_NEAR(high.p50_m, 0.048, 0.003);
  writeSurface("onboard", "map.ply", up.inverse());
  EXPECT_NEAR(scoreMission(root()).onboard_surface->bias_m, -0.048, 0.003);
}

// Five centimetres off where the mesh claims two and a half on one half and five on the other.
TEST_F(ScoreTest, ErrorsAreHeldAgainstTheUncertaintyThatTheSurfaceClaims) {
  const SE3 up(Eigen::Quaterniond::Identity(), {0, 0, -0.05});
  writeSurface("onboard", "map.ply", up);
  EXPECT_FALSE(scoreMission(root()).onboard_surface->squared_over_variance);
  Mesh mesh = readPly(root() / "onboard" / "map.ply");
  for (const Eigen::Vector3f& p : mesh.vertices) mesh.sigma.push_back(p.x() < 0 ? 0.024F : 0.048F);
  writePly(root() / "onboard" / "map.ply", mesh);
  EXPECT_NEAR(scoreMission(root()).onboard_surface->squared_over_variance.value(), (4 + 1) / 2.0, 0.4);
}

TEST_F(ScoreTest, DriftBetweenPassesIsTheCrossoverError) {
  // The second pass is 0.4 m off against the first.
  writePoses("onboard", SE3(), [](int i) { return Eigen::Vector3d(0, i > 40 ? 0.4 : 0.0, 0); });
  const auto score = scoreMission(root()).onboard;
  EXPECT_NEAR(*score->crossover_rms_m, 0.4, 1e-5);
  EXPECT_NEAR(score->rms_m, 0.4 * std::sqrt(40.0 / 81.0), 1e-5);
}

TEST_F(ScoreTest, AttitudeIsScoredAsTiltAndHeading) {
  writePoses("topside", config_.origin, [&](int i) {
    const Eigen::Quaterniond off(Eigen::AngleAxisd(0.03, Eigen::Vector3d::UnitZ()) *
                                 Eigen::AngleAxisd(i % 2 == 0 ? 0.02 : 0.0, Eigen::Vector3d::UnitY()));
    return SE3(off * trueCamera(i).rotation(), trueCamera(i).translation());
  });
  const auto score = scoreMission(root()).topside;
  EXPECT_NEAR(*score->heading_rms_rad, 0.03, 1e-4);
  EXPECT_NEAR(*score->tilt_rms_rad, 0.02 * std::sqrt(41.0 / 81.0), 1e-4);
  EXPECT_FALSE(score->nees) << "no covariances were written";
}

TEST_F(ScoreTest, PosesAreHeldAgainstTheirOwnCovariance) {
  // Every other pose is 0.3 m off to the north and 0.1 m deep; covariances are known of 61 of the 81.
  writePoses("topside", SE3(), [](int i) { return Eigen::Vector3d(0.3, 0, i % 2 == 0 ? 0.1 : 0.0); });
  std::vector<io::PoseCovariance> sure;
  for (int i = 0; i <= 60; ++i) {
    io::PoseCovariance pose{.left_image = "L" + std::to_string(i) + ".tif"};
    pose.covariance.diagonal() << 0.01, 4.0, 0.0004, 1e-4, 1e-4, 1e-4;
    sure.push_back(pose);
  }
  sure.push_back({"of another dive.tif", Matrix6d::Identity()});
  io::writePoseCovariances(root() / "topside" / "pose_covariances.csv", sure);
  const auto score = scoreMission(root()).topside;
  EXPECT_NEAR(*score->nees, 9 + 25 * 31.0 / 61.0, 1e-3);
  EXPECT_NEAR(*score->inside, 30.0 / 61.0, 1e-9);
}

TEST_F(ScoreTest, PosesOfAnotherOriginAreBroughtIntoTheMissionsFrame) {
  const LocalTransverseMercator here(config_.origin);
  const Geodetic other = here.toGeodetic({120.0, -80.0});
  writePoses("topside", other, [&](int i) {
    const SE3 camera = trueCamera(i);
    Eigen::Vector3d t = camera.translation();
    t.head<2>() = LocalTransverseMercator(other).toLocal(here.toGeodetic(t.head<2>()));
    return SE3(camera.rotation(), t);
  });
  EXPECT_LT(scoreMission(root()).topside->rms_m, 1e-4);
}

TEST_F(ScoreTest, OdometryIsPlacedAtTheTruthAndItsDriftCounts) {
  std::vector<io::TrajectoryPoint> odometry;
  for (int i = 0; i <= 400; ++i) {
    SE3 pose = truePose(i * 0.1);
    // Another horizontal origin, and 1 cm/s of drift eastwards.
    pose = SE3(pose.rotation(), pose.translation() + Eigen::Vector3d(5, -3 + 0.01 * i * 0.1, 0));
    odometry.push_back({kStart + i * 100'000'000LL, pose});
  }
  std::filesystem::create_directories(root() / "onboard");
  io::writeTrajectory(root() / "onboard" / "odometry.csv", odometry);
  // The mean square of a ramp to 0.4 m is a third of its last square.
  EXPECT_NEAR(scoreMission(root()).dead_reckoning->rms_m, 0.4 / std::sqrt(3.0), 0.002);
}

TEST_F(ScoreTest, HalfASurfaceCoversAboutHalfOfWhatWasSeen) {
  Mesh mesh = test::syntheticSeafloor();
  std::erase_if(mesh.triangles, [&](const auto& t) { return mesh.vertices[t[0]].x() > 0.4F; });
  std::filesystem::create_directories(root() / "onboard");
  writePly(root() / "onboard" / "map.ply", mesh);
  EXPECT_NEAR(scoreMission(root()).onboard_surface->coverage, 0.5, 0.08);
}

TEST_F(ScoreTest, MissingPartsAreNullAndNoted) {
  writePoses("onboard", SE3());
  const ScoreReport report = scoreMission(root());
  const auto json = nlohmann::json::parse(scoreJson(report));
  EXPECT_TRUE(json["trajectory"]["dead_reckoning"].is_null());
  EXPECT_TRUE(json["trajectory"]["onboard"]["crossover_rms_m"].is_number());
  EXPECT_TRUE(json["trajectory"]["topside"].is_null());
  EXPECT_TRUE(json["surface"]["onboard"].is_null());
  EXPECT_TRUE(json["surface"]["topside"].is_null());
  EXPECT_THAT(report.notes, ::testing::Contains(::testing::HasSubstr("topside/mesh.ply")));
}

TEST_F(ScoreTest, TheSameFilesGiveTheSameNumbers) {
  writePoses("onboard", SE3::fromEuler(0, 0, 0.02, {0.1, 0, 0}));
  writeSurface("onboard", "map.ply", SE3::fromEuler(0, 0, 0.02, {0.1, 0, 0}));
  EXPECT_EQ(scoreJson(scoreMission(root())), scoreJson(scoreMission(root())));
}

TEST_F(ScoreTest, DamagedAndAbsentFilesAreRefusedInOneLine) {
  std::filesystem::create_directories(root() / "onboard");
  std::ofstream(root() / "onboard" / "map.ply") << "ply\nformat nonsense";
  EXPECT_THROW(static_cast<void>(scoreMission(root())), InputError);
  std::filesystem::remove(root() / "onboard" / "map.ply");
  std::ofstream(root() / "truth" / "images.csv") << "utc_ns,left_image,right_image\nnonsense\n";
  EXPECT_THROW(static_cast<void>(scoreMission(root())), InputError);
  std::filesystem::remove(root() / "truth" / "trajectory.csv");
  EXPECT_THROW(static_cast<void>(scoreMission(root())), InputError);
  EXPECT_THROW(static_cast<void>(scoreMission(root() / "none")), InputError);
}

TEST(TruthSurface, FindsTheNearestPointOfAllTriangles) {
  const Mesh mesh = test::syntheticSeafloor(0.5);
  const TruthSurface surface(mesh);
  for (const Eigen::Vector3d& from : {Eigen::Vector3d(0.3, 0.2, 9.0), Eigen::Vector3d(9, 9, 9),
                                      Eigen::Vector3d(-1.7, 2.2, 10.6), Eigen::Vector3d(0, 0, 50)}) {
    // Against a dense cloud of points on the same triangles.
    double nearest = 1e9;
    for (const auto& p : sampleSurface(mesh, 200000)) nearest = std::min(nearest, (p - from).norm());
    EXPECT_NEAR(surface.nearest(from).distance, nearest, 0.02);
    EXPECT_LE(surface.nearest(from).distance, nearest + 1e-9);
  }
}

TEST(SampleSurface, SpreadsPointsEvenlyOverTheArea) {
  Mesh mesh;
  // A large triangle of 6 m2 and a small one of 2 m2.
  mesh.vertices = {{0, 0, 0}, {4, 0, 0}, {0, 3, 0}, {10, 0, 0}, {12, 0, 0}, {10, 2, 0}};
  mesh.triangles = {{0, 1, 2}, {3, 4, 5}};
  int large = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& p : sampleSurface(mesh, 8000)) {
    if (p.x() > 5) continue;
    ++large;
    sum += p;
  }
  EXPECT_NEAR(large, 6000, 2);
  EXPECT_LT((sum / large - Eigen::Vector3d(4.0 / 3.0, 1, 0)).norm(), 0.01) << "their mean is the centroid";
}

TEST(AlignLevel, RecoversHeadingAndShiftOfPointsOnALine) {
  Points truth, estimate;
  const SE3 motion = SE3::fromEuler(0, 0, 0.3, {1, 2, -0.5});
  for (int i = 0; i < 10; ++i) {
    estimate.emplace_back(i * 0.5, 0, 5);
    truth.push_back(motion * estimate.back());
  }
  const SE3 found = alignLevel(estimate, truth);
  EXPECT_LT((found.inverse() * motion).log().norm(), 1e-9);
}

}  // namespace
}  // namespace fathom::sim
