#include <gtest/gtest.h>

#include "firmware_if/pose_files.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/topside/pipeline.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::topside {
namespace {

// Simulated dive at a quarter of the image scale, rendered once by the fixture in CMakeLists.txt.
const std::filesystem::path kMission = FATHOM_REEF_MISSION;

SE3 poseAt(const std::vector<io::TrajectoryPoint>& truth, double utc_s) {
  const auto utc_ns = static_cast<std::int64_t>(utc_s * 1e9);
  const auto after =
      std::lower_bound(truth.begin() + 1, truth.end() - 1, utc_ns,
                       [](const io::TrajectoryPoint& p, std::int64_t t) { return p.utc_ns < t; });
  const auto before = after - 1;
  const double s =
      static_cast<double>(utc_ns - before->utc_ns) / static_cast<double>(after->utc_ns - before->utc_ns);
  return interpolate(before->pose, after->pose, s);
}

TEST(ReefQuick, TheMapOfASimulatedDiveLiesOnTheTrueSeafloor) {
  ASSERT_TRUE(std::filesystem::exists(kMission / "mission.toml")) << "the mission was not rendered";
  const test::TemporaryFolder out;
  const Summary done = runTopside(kMission, out.path() / "topside", {});
  EXPECT_GE(done.used, 28u);
  EXPECT_EQ(done.unreadable, 0u);

  // The dive as a whole is as far off as the GPS; that shift is taken out, everything else is the pipeline's
  // own error.
  const auto truth = io::readTrajectory(kMission / "truth" / "trajectory.csv");
  const auto poses = io::readVehiclePoses(out.path() / "topside" / "vehicle_pose_est.data").poses;
  ASSERT_EQ(poses.size(), done.pairs);
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  for (const auto& p : poses)
    shift += (poseAt(truth, p.utc_s).translation() - p.T_nav_body.translation()) /
             static_cast<double>(poses.size());
  EXPECT_LT(shift.head<2>().norm(), 4.0);
  EXPECT_LT(std::abs(shift.z()), 0.05);
  for (const auto& p : poses)
    EXPECT_LT((p.T_nav_body.translation() + shift - poseAt(truth, p.utc_s).translation()).norm(), 0.15)
        << p.id;

  Mesh mesh = readPly(out.path() / "topside" / "mesh.ply");
  const Mesh seafloor = readPly(kMission / "truth" / "terrain.ply");
  transform(mesh, SE3(Eigen::Quaterniond::Identity(), shift));
  const test::SurfaceDistance toSeafloor(seafloor, 0.25F);
  std::vector<float> errors;
  for (const auto& v : mesh.vertices) errors.push_back(toSeafloor(v));
  std::sort(errors.begin(), errors.end());
  const float median = errors[errors.size() / 2], p95 = errors[errors.size() * 95 / 100];
  std::printf("%zu vertices, %.1f m2: surface error median %.1f mm, 95 %% %.1f mm\n", mesh.vertices.size(),
              done.area, 1e3 * static_cast<double>(median), 1e3 * static_cast<double>(p95));
  EXPECT_LT(median, 0.033F);  // one voxel
  EXPECT_LT(p95, 0.10F);
}

}  // namespace
}  // namespace fathom::topside
