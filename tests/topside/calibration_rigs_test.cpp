#include <functional>

#include "tests/topside/calibration_fixture.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr;
using Json = nlohmann::ordered_json;

TEST_F(CalibrationFiles, ColmapsRigIsReadFromAnyOfItsFiles) {
  write("cameras.txt", test::colmapCameras(rig_));
  write("rigs.txt", test::colmapRigs(rig_));
  const std::string about =
      "COLMAP cameras.txt and rigs.txt (left camera 7, right camera 3), baseline 0.305 m";
  EXPECT_EQ(readsAs(at("cameras.txt"), rig_), about);
  EXPECT_EQ(readsAs(at("rigs.txt"), rig_), about);
  EXPECT_EQ(findCalibration(folder_.path()), at("cameras.txt"));
  std::filesystem::remove(at("rigs.txt"));
  EXPECT_THAT(refusal(at("cameras.txt")), HasSubstr("rigs.txt or rig_config.json"));
  std::filesystem::copy_file(at("cameras.txt"), at("rigs.txt"));
  EXPECT_THAT(refusal(at("rigs.txt")), HasSubstr("has no poses of cameras"));
  EXPECT_THAT(refusal(at("cameras.txt")), HasSubstr("rigs.txt: "));
  std::filesystem::remove(at("rigs.txt"));
  write("rig_config.json", test::colmapRigConfig(rig_).dump());
  EXPECT_THAT(readsAs(at("cameras.txt"), rig_), HasSubstr("rig_config.json (left camera 7"));
  readsAs(at("rig_config.json"), rig_);
  std::filesystem::remove(at("cameras.txt"));
  EXPECT_THAT(refusal(at("rig_config.json")), HasSubstr("cameras.txt"));
}

TEST_F(CalibrationFiles, ColmapsRigConfigMayHoldTheLenses) {
  Json config = test::colmapRigConfig(rig_);
  config[0].erase("ref_camera_id");
  Json& cameras = config[0]["cameras"];
  const std::array both{&rig_.right, &rig_.left};
  for (const std::size_t k : {0U, 1U}) {
    const Camera& c = *both[k];
    cameras[k].erase("camera_id");
    cameras[k]["camera_model_name"] = "OPENCV";
    cameras[k]["camera_params"] = {c.fx, c.fy, c.cx + 0.5, c.cy + 0.5, c.k1, c.k2, c.p1, c.p2};
  }
  cameras[1]["ref_sensor"] = true;
  StereoRig expected = withoutK3(rig_);
  expected.left.width = expected.left.height = expected.right.width = expected.right.height = 0;
  EXPECT_EQ(readsAs(write("rig_config.json", config.dump()), expected),
            "COLMAP rig_config.json (left camera 2, right camera 1), baseline 0.305 m");
  cameras[0].erase("cam_from_rig_rotation");
  EXPECT_THAT(refusal("rig_config.json", config.dump()), HasSubstr("no pose of camera 1"));
}

TEST_F(CalibrationFiles, ColmapsModelsHaveTheirParametersInOrder) {
  write("rigs.txt", "1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.2 0 0\n");
  const auto left = [&](const std::string& model) {
    write("cameras.txt", "1 " + model + "\n2 PINHOLE 64 48 50 51 32 24\n");
    return readCalibration(at("cameras.txt")).rig.left;
  };
  const auto values = [](const Camera& c) {
    return std::vector<double>{c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3};
  };
  using testing::ElementsAre;
  EXPECT_THAT(values(left("SIMPLE_PINHOLE 64 48 50 32 24")), ElementsAre(50, 50, 31.5, 23.5, 0, 0, 0, 0, 0));
  EXPECT_THAT(values(left("PINHOLE 64 48 50 51 32 24")), ElementsAre(50, 51, 31.5, 23.5, 0, 0, 0, 0, 0));
  EXPECT_THAT(values(left("SIMPLE_RADIAL 64 48 50 32 24 .1")),
              ElementsAre(50, 50, 31.5, 23.5, .1, 0, 0, 0, 0));
  EXPECT_THAT(values(left("RADIAL 64 48 50 32 24 .1 .2")), ElementsAre(50, 50, 31.5, 23.5, .1, .2, 0, 0, 0));
  EXPECT_THAT(values(left("OPENCV 64 48 50 51 32 24 .1 .2 .3 .4")),
              ElementsAre(50, 51, 31.5, 23.5, .1, .2, .3, .4, 0));
  EXPECT_THAT(values(left("FULL_OPENCV 64 48 50 51 32 24 .1 .2 .3 .4 .5 0 0 0")),
              ElementsAre(50, 51, 31.5, 23.5, .1, .2, .3, .4, .5));
}

TEST_F(CalibrationFiles, ColmapsOtherModelsAndNonsenseAreRefused) {
  write("rigs.txt", "1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.2 0 0\n");
  const auto cameras = [&](const std::string& left) {
    return refusal("cameras.txt", "1 " + left + "\n2 PINHOLE 64 48 50 51 32 24\n");
  };
  EXPECT_EQ(cameras("PINHOLE 64 48 50 51 32 24"), "");
  EXPECT_THAT(cameras("OPENCV_FISHEYE 64 48 50 51 32 24 0 0 0 0"),
              HasSubstr("'OPENCV_FISHEYE' is not known"));
  EXPECT_THAT(cameras("FULL_OPENCV 64 48 50 51 32 24 0 0 0 0 0 0.1 0 0"), HasSubstr("k4 to k6"));
  EXPECT_THAT(cameras("PINHOLE 64 48 50 51 32"), HasSubstr("line 1: PINHOLE has 4 parameters, not 3"));
  EXPECT_THAT(cameras("PINHOLE 64 48 50 51 32 nan"), HasSubstr("'nan' is no number"));
  EXPECT_THAT(cameras("PINHOLE 64 -48 50 51 32 24"), HasSubstr("image size"));
  EXPECT_EQ(cameras("PINHOLE 64 48 50 51 32 24"), "");
  const auto rigs = [&](const std::string& text) { return refusal("rigs.txt", text); };
  EXPECT_THAT(rigs("1 1 CAMERA 1\n2 1 CAMERA 2\n"), HasSubstr("it holds rig 1 with 1; rig 2 with 2"));
  EXPECT_THAT(rigs("1 3 CAMERA 1 CAMERA 2 0 CAMERA 3 0\n"), HasSubstr("it holds rig 1 with 1 2 3"));
  EXPECT_THAT(rigs("1 2 CAMERA 1 CAMERA 2 0\n"), HasSubstr("no pose of camera 2"));
  EXPECT_THAT(rigs("1 2 CAMERA 1 CAMERA 5 1 1 0 0 0 1 0 0\n"), HasSubstr("no camera 5"));
  EXPECT_THAT(rigs("1 2 CAMERA 1 CAMERA 2 1 1 1 0 0 1 0 0\n"), HasSubstr("quaternion"));
  EXPECT_THAT(rigs("1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 1 0\n"), HasSubstr("line 1: ends after 13 values"));
  EXPECT_THAT(rigs("1 1e300 CAMERA 1 CAMERA 2 1 1 0 0 0 1 0 0\n"), HasSubstr("line 1"));
  EXPECT_THAT(rigs("1 0 CAMERA 1\n"), HasSubstr("line 1"));
}

TEST_F(CalibrationFiles, MatlabsStereoParametersAreReadOldAndNew) {
  const std::string about = "(left camera 1, right camera 2), baseline 0.305 m";
  EXPECT_EQ(readsAs(write("old.json", test::matlabStruct(rig_).dump()), rig_), "MATLAB old.json " + about);
  Json object = test::matlabObject(rig_);
  EXPECT_EQ(readsAs(write("new.json", object.dump()), rig_), "MATLAB new.json " + about);
  // rigidtform3d's matrix, and a rigid3d, whose rotation is of rows.
  Json& pose = object["PoseCamera2"];
  const Json rows = test::matlabStruct(rig_)["RotationOfCamera2"], r = pose["R"], t = pose["Translation"];
  pose["A"] = {{r[0][0], r[0][1], r[0][2], t[0]},
               {r[1][0], r[1][1], r[1][2], t[1]},
               {r[2][0], r[2][1], r[2][2], t[2]},
               {0, 0, 0, 1}};
  pose.erase("R");
  readsAs(write("a.json", object.dump()), rig_);
  pose = {{"Rotation", rows}, {"Translation", t}};
  readsAs(write("rigid3d.json", object.dump()), rig_);
}

TEST_F(CalibrationFiles, WhatMatlabLeavesOpenOrGetsWrongIsRefused) {
  const Json good = test::matlabStruct(rig_);
  const auto with = [&](const std::function<void(Json&)>& change) {
    Json file = good;
    change(file);
    return refusal("m.json", file.dump());
  };
  EXPECT_EQ(with([](Json&) {}), "");
  EXPECT_THAT(with([](Json& f) { f["CameraParameters1"]["WorldUnits"] = "furlongs"; }),
              HasSubstr("'furlongs'"));
  EXPECT_THAT(with([](Json& f) { f["CameraParameters1"].erase("WorldUnits"); }), HasSubstr("--calib-unit"));
  EXPECT_THAT(with([](Json& f) { f["CameraParameters2"].erase("IntrinsicMatrix"); }),
              HasSubstr("CameraParameters2.K: is missing"));
  EXPECT_THAT(
      with([&](Json& f) { f["CameraParameters2"]["K"] = good["CameraParameters2"]["IntrinsicMatrix"]; }),
      HasSubstr("CameraParameters2.K: is not fx 0 cx"));
  EXPECT_THAT(with([](Json& f) { f["CameraParameters2"]["IntrinsicMatrix"][1][0] = 0.5; }),
              HasSubstr("skew"));
  EXPECT_THAT(with([](Json& f) {
                f["CameraParameters2"]["RadialDistortion"] = {0, nullptr};
              }),
              HasSubstr("RadialDistortion"));
  EXPECT_THAT(with([](Json& f) { f["RotationOfCamera2"][0][0] = 3; }), HasSubstr("RotationOfCamera2"));
  EXPECT_THAT(with([](Json& f) { f.erase("TranslationOfCamera2"); }), HasSubstr("PoseCamera2"));
  EXPECT_THAT(with([](Json& f) { f["PoseCamera2"] = 3; }), HasSubstr("PoseCamera2"));
}

}  // namespace
}  // namespace fathom::topside
