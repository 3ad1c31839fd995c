#include "recon/topside/pipeline.hpp"
#include "recon/topside/commands/commands.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/topside/commands/commands.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/missions.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::vector<fs::path> imagesOf(const fs::path& mission) {
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(mission / "img")) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  return paths;
}

void cut(const fs::path& path) {
  fs::resize_file(path, fs::file_size(path) / 3);
}

std::string errorOf(const fs::path& mission, const TopsideConfig& config = {}) {
  return test::refusal([&] { (void)runTopside(mission, mission / "topside", config); });
}

class TopsidePipeline : public ::testing::Test {
 protected:
  void SetUp() override { scene_.write(mission()); }
  [[nodiscard]] const fs::path& mission() const { return folder_.path(); }
  [[nodiscard]] fs::path result(const std::string& name) const { return mission() / "topside" / name; }

  test::TinyMission scene_;
  test::TemporaryFolder folder_;
};

TEST_F(TopsidePipeline, TheMapIsOnTheTrueSeafloor) {
  const Summary done = runTopside(mission(), mission() / "topside", {});
  EXPECT_EQ(done.used, 8u);
  const Mesh mesh = readPly(result("mesh.ply"));
  ASSERT_GT(mesh.vertices.size(), 1000u);
  double sum = 0, bias = 0;
  for (const auto& v : mesh.vertices) {
    const double error = static_cast<double>(v.z()) - scene_.seafloor(v.x());
    sum += error * error;
    bias += error / static_cast<double>(mesh.vertices.size());
  }
  // At this small image scale one sigma of a single point is 2 cm.
  EXPECT_LT(std::sqrt(sum / static_cast<double>(mesh.vertices.size())), 0.02);
  EXPECT_LT(std::abs(bias), 0.01);
  for (const auto& n : mesh.normals) EXPECT_LT(n.z(), 0.0F);
  // 1.75 m of track and a footprint of about 1.2 x 1.6 m.
  EXPECT_GT(done.area, 4.0);
  EXPECT_LT(done.area, 5.0);
}

TEST_F(TopsidePipeline, PosesAreTheTrueOnesAnchoredByGps) {
  (void)runTopside(mission(), mission() / "topside", {});
  const io::StereoPoseFile stereo = io::readStereoPoses(result("stereo_pose_est.data"));
  const io::VehiclePoseFile vehicle = io::readVehiclePoses(result("vehicle_pose_est.data"));
  ASSERT_EQ(stereo.poses.size(), 8u);
  ASSERT_EQ(vehicle.poses.size(), 8u);
  for (std::size_t k = 0; k < 8; ++k) {
    const Eigen::Vector3d truth(scene_.first_north + 0.25 * static_cast<double>(k), scene_.east,
                                scene_.body_depth);
    EXPECT_LT((vehicle.poses[k].T_nav_body.translation() - truth).norm(), 0.01) << k;
    const Eigen::Vector3d camera = truth + Eigen::Vector3d(0.2, -0.035, 0.1);
    EXPECT_LT((stereo.poses[k].T_nav_cam.translation() - camera).norm(), 0.01) << k;
    EXPECT_FALSE(stereo.poses[k].left_image.empty());
    EXPECT_GT(stereo.poses[k].footprint_radius, 0.4);
    EXPECT_NEAR(stereo.poses[k].altitude, scene_.seafloor(truth.x() - 0.3) - 10.1, 0.05);
  }
}

TEST(TopsideConfig, TheModelIsSetByTheFileAndTheCommandLineAboveIt) {
  const test::TemporaryFolder folder;
  const auto file = (folder.path() / "run.toml").string();
  std::ofstream(file) << "[model]\nblend = \"average\"\npictures = \"webp\"\ngpu_texture = \"dds\"\n";
  const auto model = [&](const std::string& options) {
    CLI::App app;
    RunSettings settings;
    addRunSettings(app, settings);
    app.parse("mission --config " + file + options);
    return configOf(settings).model;
  };
  EXPECT_EQ(model("").blend.mode, surface::BlendMode::kAverage);
  EXPECT_EQ(model("").picture.format, PictureFormat::kWebp);
  EXPECT_EQ(model("").gpu_texture, GpuTexture::kDds);
  EXPECT_EQ(model(" --mode bands").blend.mode, surface::BlendMode::kBands);
  EXPECT_EQ(model(" --textures jpeg").picture.format, PictureFormat::kJpeg);
  EXPECT_EQ(model(" --textures jpeg").gpu_texture, GpuTexture::kNone);
}

TEST_F(TopsidePipeline, TheReportTellsTimesCountsAndVersionAndIsOnePage) {
  (void)runTopside(mission(), mission() / "topside", {});
  const auto report = nlohmann::json::parse(test::readText(result("report.json")));
  EXPECT_EQ(report["pairs"]["listed"], 8);
  EXPECT_EQ(report["pairs"]["used"], 8);
  EXPECT_EQ(report["software_version"], FATHOM_VERSION);
  EXPECT_EQ(report["navigation"]["anchor"]["source"], "gps");
  EXPECT_EQ(report["config"]["fusion"]["voxel_m"], TopsideConfig().fusion.voxel);
  EXPECT_EQ(report["config"]["model"]["blend"], "bands");
  for (const char* camera : {"left", "right"}) {
    const auto& light = report["lighting"][camera];
    EXPECT_THAT(light["model"].get<std::string>(), ::testing::AnyOf("plain", "range-dependent")) << camera;
    EXPECT_LT(light["outlier_share"].get<double>(), 0.2) << camera;
    EXPECT_GT(light["memory_bytes"].get<std::size_t>(), 10000U) << camera;
  }
  EXPECT_EQ(report["navigation"]["anchor"]["fixes_used"], 10);
  for (const char* stage : {"read", "lighting", "stereo", "mesh", "fusion"})
    EXPECT_GT(report["times"]["per_pair_s"][stage].get<double>(), 0.0) << stage;
  EXPECT_GT(report["times"]["total_s"].get<double>(), 0.0);
  const std::string html = test::readText(result("report.html"));
  EXPECT_THAT(html, HasSubstr("data:image/png;base64,iVBORw0KGgo"));
  for (const char* title : {"Map", "Track", "Times", "Model", "Layers", "Lighting", "Counts"})
    EXPECT_THAT(html, HasSubstr(R"({"title":")" + std::string(title) + R"(","parts":[)")) << title;
  EXPECT_THAT(html, ::testing::Not(HasSubstr("src=\"http")));
}

TEST_F(TopsidePipeline, TheResultDoesNotDependOnTheNumberOfThreads) {
  TopsideConfig config;
  config.threads = 1;
  (void)runTopside(mission(), mission() / "topside", config);
  const std::string mesh = test::readText(result("mesh.ply")),
                    poses = test::readText(result("stereo_pose_est.data"));
  config.threads = 4;
  (void)runTopside(mission(), mission() / "topside", config);
  EXPECT_TRUE(mesh == test::readText(result("mesh.ply")));
  EXPECT_TRUE(poses == test::readText(result("stereo_pose_est.data")));
}

TEST_F(TopsidePipeline, AnUnreadableImageIsSkippedAndReported) {
  const auto images = imagesOf(mission());
  cut(images[6]);
  fs::remove(images[9]);
  const Summary done = runTopside(mission(), mission() / "topside", {});
  EXPECT_EQ(done.unreadable, 2u);
  EXPECT_EQ(done.used, 6u);
  const auto report = nlohmann::json::parse(test::readText(result("report.json")));
  EXPECT_EQ(report["pairs"]["unreadable"], 2);
  EXPECT_THAT(report["pairs"]["unreadable_images"][0].get<std::string>(),
              HasSubstr(images[6].filename().string()));
}

TEST_F(TopsidePipeline, AMissionWithoutAUsablePairIsBadInputAndLeavesTheOldResultsAlone) {
  (void)runTopside(mission(), mission() / "topside", {});
  const std::string before = test::readText(result("report.json"));
  for (const fs::path& image : imagesOf(mission())) cut(image);
  EXPECT_THAT(errorOf(mission()), HasSubstr("no usable stereo pair of 8: 8 unreadable"));
  EXPECT_EQ(test::readText(result("report.json")), before);
  EXPECT_FALSE(fs::exists(mission() / "topside.tmp"));
}

TEST_F(TopsidePipeline, ForeignFilesInTheOutputFolderAreNeverLost) {
  fs::create_directories(mission() / "topside");
  std::ofstream(result("thesis.tex")) << "years of work";
  EXPECT_THAT(errorOf(mission()), HasSubstr("thesis.tex"));
  EXPECT_EQ(test::readText(result("thesis.tex")), "years of work");
}

TEST_F(TopsidePipeline, ForeignFilesAreFoundAmongTheFilesOfARun) {
  TopsideConfig config;
  config.model.gpu_texture = GpuTexture::kKtx2;
  (void)runTopside(mission(), mission() / "topside", config);
  config.model.gpu_texture = GpuTexture::kDds;
  (void)runTopside(mission(), mission() / "topside", config);
  EXPECT_EQ(errorOf(mission(), config), "");
  for (const char* name :
       {"layers/mine.tif", "layers/slope.qgz", "tiles/0/notes.txt", "tiles/mine/0_0.glb"}) {
    test::writeText(result(name), "years of work");
    EXPECT_THAT(errorOf(mission()), HasSubstr(name));
    EXPECT_EQ(test::readText(result(name)), "years of work");
    fs::remove(result(name));
  }
}

TEST_F(TopsidePipeline, ResultsAnywhereLeadToTheMissionsImages) {
  const test::TemporaryFolder elsewhere;
  const fs::path deep = elsewhere.path() / "a/b/results";
  for (const fs::path& out : {mission() / "topside", deep}) {
    RunPlaces places{mission(), mission() / "topside.work", out, {}};
    (void)runTopside(places, {});
    const auto scene = nlohmann::json::parse(test::readText(out / "scene.json"));
    const fs::path images = scene["image_folder"].get<std::string>();
    EXPECT_TRUE(images.is_relative());
    EXPECT_TRUE(fs::equivalent(out / images, mission() / "img")) << images;
    EXPECT_TRUE(fs::equivalent(out / scene["mission"].get<std::string>(), mission()));
    if (out != deep) {
      EXPECT_EQ(images, "../img");
    }
  }
}

TEST_F(TopsidePipeline, AMissionNamedFromWhereOneStandsLeadsToItsImagesToo) {
  const fs::path before = fs::current_path();
  fs::current_path(mission());
  (void)runTopside({".", "", "", {}}, {});
  fs::current_path(before);
  const auto scene = nlohmann::json::parse(test::readText(result("scene.json")));
  EXPECT_EQ(scene["image_folder"], "../img");
  EXPECT_EQ(scene["mission"], "..");
}

TEST_F(TopsidePipeline, FusionKnowsHowFarMeshesDisagree) {
  (void)runTopside(mission(), mission() / "topside", {});
  io::StereoPoseFile poses = io::readStereoPoses(result("stereo_pose_est.data"));
  constexpr double kApart = 0.25;  // every other mesh is so much deeper [m]
  for (std::size_t k = 0; k < poses.poses.size(); k += 2) {
    const SE3& T = poses.poses[k].T_nav_cam;
    poses.poses[k].T_nav_cam = SE3(T.rotation(), T.translation() + Eigen::Vector3d(0, 0, kApart));
  }
  RunPlaces places{mission(), mission() / "topside.work", mission() / "topside", {}};
  places.input.poses = mission() / "disagreeing.data";
  io::writeStereoPoses(places.input.poses, poses);
  TopsideConfig config;
  config.fusion.carve = false;
  (void)runTopside(places, config);
  // A ramp of 0.1 m would keep two surfaces, one as wide as their spread makes one between them.
  std::size_t between = 0, all = 0;
  for (const auto& v : readPly(result("mesh.ply")).vertices) {
    const double above = static_cast<double>(v.z()) - scene_.seafloor(static_cast<double>(v.x()));
    if (std::abs(static_cast<double>(v.x()) - 4) > 0.5) continue;  // where all meshes overlap others
    ++all;
    if (std::abs(above - kApart / 2) < kApart / 4) ++between;
  }
  EXPECT_GT(static_cast<double>(between), 0.5 * static_cast<double>(all)) << between << " of " << all;
}

TEST_F(TopsidePipeline, AnAbsentOrBrokenFileIsNamedInOneLine) {
  EXPECT_THAT(errorOf("/nowhere/at/all"), HasSubstr("/nowhere/at/all"));
  std::ofstream(mission() / "stereo.calib") << "2 340 256";
  EXPECT_THAT(errorOf(mission()), HasSubstr("stereo.calib"));
  fs::remove(mission() / "sensors.lcmlog");
  scene_.write(mission());
  std::ofstream(mission() / "sensors.lcmlog", std::ios::trunc).close();
  const std::string error = errorOf(mission());
  EXPECT_THAT(error, HasSubstr(mission().string()));
  EXPECT_EQ(error.find('\n'), std::string::npos);
}

TEST_F(TopsidePipeline, WithoutGpsOrUsblTheMapIsAtTheOriginAndTheReportSaysSo) {
  test::TinyMission scene{.gps = false};
  const test::TemporaryFolder folder;
  scene.write(folder.path());
  cut(imagesOf(folder.path())[3]);
  const Summary done = runTopside(folder.path(), folder.path() / "topside", {});
  ASSERT_GE(done.to_know.size(), 2u);
  EXPECT_THAT(done.to_know.rbegin()[1], HasSubstr("1 pairs are unreadable; the first: "));
  EXPECT_THAT(done.to_know.back(), HasSubstr("No position fix places the dive"));
  EXPECT_EQ(done.out, folder.path() / "topside");
  const auto report = nlohmann::json::parse(test::readText(folder.path() / "topside" / "report.json"));
  EXPECT_EQ(report["navigation"]["anchor"]["source"], "none");
  const auto poses = io::readVehiclePoses(folder.path() / "topside" / "vehicle_pose_est.data");
  // odom begins where dead reckoning does, 10 m before the first pair.
  EXPECT_NEAR(poses.poses[0].T_nav_body.translation().x(), 10.0, 0.05);
  EXPECT_NEAR(poses.poses[0].T_nav_body.translation().y(), 0.0, 0.01);
}

}  // namespace
}  // namespace fathom::topside
