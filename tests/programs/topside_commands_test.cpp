#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "recon/geometry/ply.hpp"
#include "tests/support/program_run.hpp"

namespace fathom::test {
namespace {

// The fifth pair of the simulated dive, its images a quarter of the full size, 2 m over the seafloor.
class StereoProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    std::vector<std::filesystem::path> left, right;
    for (const auto& entry : std::filesystem::directory_iterator(mission_ / "img"))
      (entry.path().string().find("_LC16") != std::string::npos ? left : right).push_back(entry.path());
    ASSERT_GT(left.size(), 5U);
    std::sort(left.begin(), left.end());
    std::sort(right.begin(), right.end());
    left_ = left[5];
    right_ = right[5];
  }
  [[nodiscard]] std::string command(const std::string& options) const {
    return "fathom-topside stereo --calib " + (mission_ / "stereo.calib").string() + " " + left_.string() +
           " " + right_.string() + " " + options;
  }

  std::filesystem::path mission_ = FATHOM_REEF_MISSION, left_, right_;
  TemporaryFolder folder_;
};

TEST_F(StereoProgram, APairBecomesMeshPointsPictureAndJson) {
  const auto place = [&](const char* name) { return (folder_.path() / name).string(); };
  const Outcome run = runProgram(command("--altitude 2 --features 500 --json --out " + place("m.ply") +
                                         " --points " + place("p.csv") + " --picture " + place("d.png")));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = nlohmann::json::parse(run.out);
  const auto points = json.at("points").get<std::size_t>();
  EXPECT_GT(points, 250U);
  std::size_t rejected = 0;
  for (const auto& [cause, count] : json.at("rejected").items()) rejected += count.get<std::size_t>();
  EXPECT_EQ(points + rejected, json.at("corners").get<std::size_t>());
  for (const char* stage : {"read", "pyramids", "corners", "tracking", "total"})
    EXPECT_GE(json.at("ms").at(stage).get<double>(), 0) << stage;

  std::istringstream csv(readText(place("p.csv")));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line, "u_left,v_left,u_right,v_right,x_m,y_m,z_m,sigma_z_m");
  std::size_t rows = 0;
  while (std::getline(csv, line)) {
    double v[8];
    ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf", v, v + 1, v + 2, v + 3, v + 4,
                          v + 5, v + 6, v + 7),
              8)
        << line;
    EXPECT_GT(v[6], 0.5);
    EXPECT_LT(v[6], 4.0);
    EXPECT_GT(v[7], 0.0);
    ++rows;
  }
  EXPECT_EQ(rows, points);
  EXPECT_EQ(readPly(place("m.ply")).vertices.size(), points);
  EXPECT_EQ(readText(place("d.png")).substr(1, 3), "PNG");
}

TEST_F(StereoProgram, WithoutAnAltitudeTheSeafloorIsFound) {
  const Outcome given = runProgram(command("--altitude 2 --json"));
  const Outcome found = runProgram(command("--json"));
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const auto a = nlohmann::json::parse(given.out), b = nlohmann::json::parse(found.out);
  EXPECT_EQ(b.at("seed_plane").at("from"), "wide search");
  EXPECT_NEAR(b.at("median_depth_m"), a.at("median_depth_m").get<double>(), 0.02);
  EXPECT_GE(b.at("points").get<double>(), 0.95 * a.at("points").get<double>());
}

TEST_F(StereoProgram, WhatCannotBeUsedIsRefusedInOneLineAndLeavesNothing) {
  const std::string calib = (mission_ / "stereo.calib").string(), out = (folder_.path() / "m.ply").string();
  expectRefused("fathom-topside stereo " + left_.string() + " " + right_.string(), "--calib");
  expectRefused("fathom-topside stereo --calib " + calib + " /absent.tif " + right_.string(), "/absent.tif");
  expectRefused(command("--out " + folder_.path().string()), "--out");
  expectRefused(command("--out /no/such/folder/m.ply"), "/no/such/folder");
  expectRefused(command("--altitude 0"), "--altitude");
  expectRefused(
      "fathom-topside stereo --calib " + left_.string() + " " + left_.string() + " " + right_.string(),
      left_.string());
  for (const Damage kind : kEveryDamage) {
    const std::filesystem::path bad = folder_.path() / "bad.tif";
    std::filesystem::remove_all(bad);
    std::filesystem::copy(left_, bad);
    damage(bad, kind);
    expectRefused("fathom-topside stereo --calib " + calib + " " + bad.string() + " " + right_.string() +
                      " --out " + out,
                  bad.string());
  }
  EXPECT_FALSE(std::filesystem::exists(out));
}

TEST_F(StereoProgram, ImagesWithoutAParallaxGiveNoMeshAndSaySo) {
  const std::string out = (folder_.path() / "m.ply").string();
  const Outcome run = runProgram("fathom-topside stereo --calib " + (mission_ / "stereo.calib").string() +
                                 " " + left_.string() + " " + left_.string() + " --out " + out);
  EXPECT_EQ(run.exit_code, 1);
  ASSERT_EQ(linesOf(run.err).size(), 1U) << run.err;
  EXPECT_THAT(run.err, ::testing::HasSubstr("no surface found"));
  EXPECT_FALSE(std::filesystem::exists(out));
}

TEST(ExportModelProgram, WhatCannotBeHandedOnIsRefusedInOneLineAndLeavesNothing) {
  const TemporaryFolder folder;
  const std::string command = "fathom-topside export-model ", out = (folder.path() / "out").string();
  expectRefused(command + FATHOM_REEF_MISSION, "name what to write");
  expectRefused(command + "/absent --colmap " + out, "/absent");
  expectRefused(
      command + FATHOM_REEF_MISSION " --work " + (folder.path() / "work").string() + " --colmap " + out,
      (folder.path() / "work").string());
  expectRefused(command + FATHOM_REEF_MISSION " --text", "--colmap");
  expectRefused(command + FATHOM_REEF_MISSION " --cell 0.01 --gpkg " + out, "--ortho");
  for (const char* format : {"--ply ", "--glb ", "--las "})
    expectRefused(command + "/absent " + format + out, "level 0");
  expectRefused(command + "/absent --gpkg " + out, "/absent/scene.json");
  expectRefused(command + "/absent --crs EPSG:1 --ortho " + out, "EPSG:1");
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(SlamProgram, ADiveGetsPosesClosuresAndAPage) {
  const TemporaryFolder folder;
  const std::filesystem::path out = folder.path() / "slam";
  const std::string slam =
      "fathom-topside slam " FATHOM_REEF_MISSION " --work " + (folder.path() / "work").string();
  const Outcome run = runProgram(slam + " --out " + out.string());
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, ::testing::HasSubstr("odometry links"));
  for (const char* name : {"stereo_pose_est.data", "vehicle_pose_est.data", "closures.csv",
                           "pose_covariances.csv", "slam.html", "slam.json"})
    EXPECT_GT(readText(out / name).size(), 50U) << name;
  expectRefused("fathom-topside slam /absent", "/absent");
  expectRefused(slam + " --out /dev/null", "/dev/null");
}

TEST(PosegraphProgram, AnInformationThatIsNotPositiveIsRefusedByLineOrReplacedAndSaid) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "a.g2o";
  writeText(file,
            "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 5 0 0 0 0 0 1\n"
            "EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1 2 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4\n");
  const Outcome refused = runProgram("fathom-topside posegraph " + file.string());
  EXPECT_NE(refused.exit_code, 0);
  EXPECT_THAT(refused.err,
              ::testing::AllOf(::testing::HasSubstr("line 3"), ::testing::HasSubstr("--nearest-positive")));
  const Outcome run = runProgram("fathom-topside posegraph " + file.string() + " --nearest-positive --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, ::testing::HasSubstr("1 of 1 edges"));
  EXPECT_NEAR(nlohmann::json::parse(run.out).at("chi2").get<double>(), 0, 1e-9);
}

TEST(PosegraphProgram, AGraphIsSolvedAndNonsenseRefused) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "a.g2o";
  const std::string information = " 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4\n";
  writeText(file,
            "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 5 0 0 0 0 0 1\n"
            "EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1" +
                information + "EDGE_SE3:QUAT 0 1 2 0 0 0 0 0 1" + information);
  const Outcome run = runProgram("fathom-topside posegraph " + file.string() + " --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = nlohmann::json::parse(run.out);
  EXPECT_NEAR(json.at("chi2").get<double>(), 0.5, 1e-6);  // both a half metre off
  EXPECT_EQ(json.at("poses"), 2);
  const Outcome stepwise = runProgram("fathom-topside posegraph " + file.string() + " --incremental --json");
  ASSERT_EQ(stepwise.exit_code, 0) << stepwise.err;
  const auto by_step = nlohmann::json::parse(stepwise.out);
  EXPECT_NEAR(by_step.at("chi2").get<double>(), 0.5, 1e-6);
  EXPECT_EQ(by_step.at("steps"), 2);
  EXPECT_EQ(by_step.at("heap_calls_per_step"), 0) << "pose by pose it is what runs on board";
  for (const auto* one : {&json, &by_step}) {
    std::vector<std::string> keys;
    for (const auto& [key, value] : one->items()) keys.push_back(key);
    EXPECT_THAT(keys, ::testing::UnorderedElementsAre("chi2", "poses", "steps", "step_ms",
                                                      "heap_calls_per_step", "memory_bytes", "total_s"));
  }
  for (const Damage kind : {Damage::kAbsent, Damage::kEmpty, Damage::kFolder, Damage::kNonsense}) {
    std::filesystem::remove_all(file);
    writeText(file, "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n");
    damage(file, kind);
    expectRefused("fathom-topside posegraph " + file.string(), file.string());
  }
}

}  // namespace
}  // namespace fathom::test
