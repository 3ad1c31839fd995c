#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "recon/geometry/mesh_io.hpp"
#include "recon/geometry/rigid_alignment.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/reef_quick.hpp"
#include "tests/topside/true_shift.hpp"

namespace fathom::topside {
namespace {

TEST_F(ReefQuick, TheMapOfASimulatedDiveLiesOnTheTrueSeafloor) {
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
  EXPECT_LT(median, 0.033F);  // one voxel
  EXPECT_LT(p95, 0.10F);
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
  EXPECT_LT(error, 0.033);  // twice what was measured
}

}  // namespace
}  // namespace fathom::topside
