#include <gtest/gtest.h>

#include "recon/geometry/mesh_io.hpp"
#include "recon/topside/pipeline.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/test_data.hpp"
#include "tests/topside/true_shift.hpp"

namespace fathom::topside {
namespace {

// Simulated dive at a quarter of the image scale, rendered once by the fixture in CMakeLists.txt.
const std::filesystem::path kMission = FATHOM_REEF_MISSION;

TEST(ReefQuick, TheMapOfASimulatedDiveLiesOnTheTrueSeafloor) {
  ASSERT_TRUE(std::filesystem::exists(kMission / "mission.toml")) << "the mission was not rendered";
  const test::TemporaryFolder out;
  const Summary done = runTopside(kMission, out.path() / "topside", {});
  EXPECT_GE(done.used, 28u);
  EXPECT_EQ(done.unreadable, 0u);

  const Eigen::Vector3d shift = shiftToTruth(kMission, out.path() / "topside", done.pairs, 0.15);

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
