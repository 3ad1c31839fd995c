#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "firmware_if/files/pose_files.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/topside/pipeline.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
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

// What a diver's stereo camera leaves: folders of PNG images, numbered, and poses from elsewhere.
TEST(ReefQuick, ImagesOfAnyNameWithGivenPosesMakeTheSameMap) {
  const test::TemporaryFolder out;
  const Summary first = runTopside(kMission, out.path() / "topside", {});
  const std::filesystem::path folder = out.path() / "dive";
  for (const char* side : {"left", "right"}) std::filesystem::create_directories(folder / side);
  std::filesystem::copy(kMission / "stereo.calib", folder / "stereo.calib");
  io::StereoPoseFile poses = io::readStereoPoses(out.path() / "topside" / "stereo_pose_est.data");
  for (std::size_t k = 0; k < poses.poses.size(); ++k) {
    io::StereoPose& pose = poses.poses[k];
    for (auto& [side, name] :
         {std::pair("left/", &pose.left_image), std::pair("right/", &pose.right_image)}) {
      const std::string numbered = side + std::to_string(k) + ".png";
      const cv::Mat image = cv::imread((kMission / "img" / *name).string(), cv::IMREAD_UNCHANGED);
      cv::imwrite((folder / numbered).string(), image);
      *name = numbered;
    }
  }
  io::writeStereoPoses(folder / "stereo_pose_est.data", poses);
  RunPlaces places{folder, out.path() / "work", out.path() / "model", {}};
  places.input.left_format = "bayer-rggb";
  const Summary again = runTopside(places, {});
  EXPECT_EQ(again.used, first.used);
  EXPECT_NEAR(again.area, first.area, 0.02 * first.area);
  EXPECT_THAT(test::readText(out.path() / "model" / "images.json"), testing::HasSubstr("left/0.png"));
}

}  // namespace
}  // namespace fathom::topside
