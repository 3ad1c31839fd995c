#include "tests/topside/calibration_fixture.hpp"

namespace fathom::topside {
namespace {

using test::replaced, testing::AllOf, testing::HasSubstr, testing::Not;
using Json = nlohmann::ordered_json;

TEST_F(CalibrationFiles, AStereoCalibIsReadAsEver) {
  writeStereoCalib(at("a.txt"), rig_);
  EXPECT_EQ(readsAs(at("a.txt"), rig_), "");
  EXPECT_THAT(refusal("s.calib", "2 1360 fish"), HasSubstr("number 3"));
  EXPECT_THAT(test::refusal([&] { (void)readCalibration(at("a.txt"), 0.001); }), HasSubstr("in metres"));
}

TEST_F(CalibrationFiles, OpenCvWritesThreeForms) {
  for (const char* name : {"stereo.yml", "stereo.yaml", "stereo.xml", "stereo.json"}) {
    test::writeOpenCv(at(name), rig_);
    EXPECT_EQ(readsAs(at(name), rig_),
              "OpenCV " + std::string(name) + " (left K1, right K2), baseline 0.305 m");
    // The content counts, not the name.
    std::filesystem::rename(at(name), at("renamed"));
    readsAs(at("renamed"), rig_);
  }
}

TEST_F(CalibrationFiles, OpenCvsSampleWritesTwoFilesWithoutASize) {
  StereoRig expected = rig_;
  expected.left.width = expected.left.height = expected.right.width = expected.right.height = 0;
  test::writeOpenCvPair(at("intrinsics.yml"), at("extrinsics.yml"), rig_);
  EXPECT_EQ(readsAs(at("intrinsics.yml"), expected),
            "OpenCV intrinsics.yml and extrinsics.yml (left M1, right M2), baseline 0.305 m");
  EXPECT_EQ(readsAs(at("extrinsics.yml"), expected),
            "OpenCV extrinsics.yml and intrinsics.yml (left M1, right M2), baseline 0.305 m");
  EXPECT_EQ(findCalibration(folder_.path()), at("extrinsics.yml"));

  StereoRig read = readCalibration(at("intrinsics.yml")).rig;
  const auto take = [&](std::array<int, 2> left, std::array<int, 2> right) {
    return test::refusal([&] { takeSizes(read, at("intrinsics.yml"), left, right); });
  };
  EXPECT_THAT(take({0, 0}, {0, 0}), HasSubstr("gives no image size"));
  EXPECT_THAT(take({640, 480}, {640, 480}), AllOf(HasSubstr("692.3 498.1"), HasSubstr("640 x 480")));
  read = readCalibration(at("intrinsics.yml")).rig;
  EXPECT_EQ(take({1360, 1024}, {1280, 1024}), "");
  expectRig(read, rig_);
  EXPECT_EQ(take({1, 1}, {1, 1}), "");  // what is known stays

  std::filesystem::remove(at("extrinsics.yml"));
  EXPECT_THAT(refusal(at("intrinsics.yml")), HasSubstr("no R and T"));
  test::writeOpenCvPair(at("intrinsics.yml"), at("extrinsics.yml"), rig_);
  std::filesystem::remove(at("intrinsics.yml"));
  EXPECT_THAT(refusal(at("extrinsics.yml")), HasSubstr("no pair of camera matrices"));
}

TEST_F(CalibrationFiles, PeopleWriteOpenCvsNamesInManyForms) {
  const Json k{{1700, 0, 690}, {0, 1701, 500}, {0, 0, 1}}, d{0.1, 0.2, 0.01, 0.02};
  const Json r{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, t{-0.2, 0, 0};
  const Camera camera{1360, 1024, 1700, 1701, 690, 500, 0.1, 0.2, 0.01, 0.02, 0};
  const StereoRig expected{camera, camera, SE3(Eigen::Quaterniond::Identity(), {-0.2, 0, 0})};
  const std::vector<Json> files{{{"cameraMatrix1", k},
                                 {"distCoeffs1", d},
                                 {"cameraMatrix2", k},
                                 {"distCoeffs2", d},
                                 {"R", r},
                                 {"T", t},
                                 {"imageSize", {1360, 1024}}},
                                {{"camera_matrix_left", k},
                                 {"dist_coeffs_left", d},
                                 {"camera_matrix_right", k},
                                 {"dist_coeffs_right", {d}},
                                 {"rotation_matrix", r},
                                 {"translation_vector", {{-0.2}, {0}, {0}}},
                                 {"image_width", 1360},
                                 {"image_height", 1024}},
                                {{"LEFT.K", k},
                                 {"LEFT.D", d},
                                 {"RIGHT.K", k},
                                 {"RIGHT.D", d},
                                 {"r", {0, 0, 0}},
                                 {"t", t},
                                 {"LEFT.width", 1360},
                                 {"LEFT.height", 1024},
                                 {"RIGHT.width", 1360},
                                 {"RIGHT.height", 1024}},
                                {{"left", {{"K", k}, {"D", d}, {"image_size", {1360, 1024}}}},
                                 {"right", {{"K", k}, {"D", d}, {"image_size", {1360, 1024}}}},
                                 {"stereo", {{"R", r}, {"T", t}}}},
                                {{"K1", k},
                                 {"k1", 0.1},
                                 {"D1", d},
                                 {"K2", k},
                                 {"k2", 0.2},
                                 {"D2", d},
                                 {"om", {0, 0, 0}},
                                 {"T", t},
                                 {"size", {1360, 1024}}}};
  for (const Json& file : files) readsAs(write("any", file.dump()), expected);
}

TEST_F(CalibrationFiles, ARotationVectorTurnsAsOpenCvsDoes) {
  test::writeOpenCv(at("s.json"), rig_);
  Json file = Json::parse(test::readText(at("s.json")));
  const Vector6d turn = SE3(rig_.T_right_left.rotation(), Eigen::Vector3d::Zero()).log();
  file["R"] = {turn(3), turn(4), turn(5)};
  readsAs(write("s.json", file.dump()), rig_);
  file["R"] = {30, 0, 0};
  EXPECT_THAT(refusal("s.json", file.dump()), HasSubstr("no rotation vector"));
}

TEST_F(CalibrationFiles, MillimetresAreNotGuessedButTakenWhenSaid) {
  test::writeOpenCv(at("mm.yml"), rig_, 0.001);
  EXPECT_THAT(refusal(at("mm.yml")), AllOf(HasSubstr("305."), HasSubstr("--calib-unit mm")));
  readsAs(at("mm.yml"), rig_, 0.001);
}

TEST_F(CalibrationFiles, OpenCvsOtherLensesAndNonsenseAreRefused) {
  test::writeOpenCv(at("s.json"), rig_);
  const Json good = Json::parse(test::readText(at("s.json")));
  const auto with = [&](const char* key, const Json& value) {
    Json file = good;
    file[key] = value;
    return refusal("bad.json", file.dump());
  };
  EXPECT_EQ(with("anything", 3), "");
  EXPECT_THAT(with("D1", {0, 0, 0, 0, 0, 0, 0, 0, 0.1, 0, 0, 0}),
              HasSubstr("D1: has coefficients of the thin"));
  EXPECT_THAT(with("D1", {0, 0, 0, 0, 0, 30, 0, 0}), HasSubstr("D1: is a rational lens"));
  EXPECT_THAT(with("D1", {-9, 0, 0, 0, 0, 0, 0, 1}), HasSubstr("D1: is a rational lens"));
  EXPECT_EQ(with("D1", {0, 0, 0, 0, 0, 0, 0, 0}), "");
  EXPECT_THAT(with("D1", {0, 0, 0}), HasSubstr("D1: holds 3 distortion coefficients"));
  EXPECT_THAT(with("D1", {0, 0, 0, nullptr}), HasSubstr("D1: holds something else"));
  EXPECT_THAT(with("D1", {0, 0, 0, 1e300}), HasSubstr("D1"));
  EXPECT_THAT(with("D1", "none"), HasSubstr("gives no distortion"));
  EXPECT_THAT(with("distortion_model", "fisheye"), HasSubstr("'fisheye'"));
  EXPECT_EQ(with("distortion_model", "plumb_bob"), "");
  EXPECT_THAT(with("K1", {1700, 3, 690, 0, 1700, 500, 0, 0, 1}), HasSubstr("K1: has a skew"));
  EXPECT_THAT(with("K1", {1700, 0, 690, 0, 1700, 500, 0, 0, 2}), HasSubstr("K1"));
  EXPECT_THAT(with("K1", {-1700, 0, 690, 0, 1700, 500, 0, 0, 1}), HasSubstr("focal length"));
  EXPECT_THAT(with("K1", {1e9, 0, 690, 0, 1700, 500, 0, 0, 1}), HasSubstr("focal length"));
  EXPECT_THAT(with("K1", {1700, 0, 1e9, 0, 1700, 500, 0, 0, 1}), HasSubstr("principal point"));
  EXPECT_THAT(with("K1", {1700, 0, 1400, 0, 1700, 500, 0, 0, 1}), HasSubstr("principal point"));
  EXPECT_THAT(with("K1", {1700, 0, 690, 0, 1700, 500, 0, 0}), HasSubstr("K1: holds 8 numbers, not 9"));
  EXPECT_THAT(with("R", {1, 0, 0, 0, 1, 0, 0, 0, -1}), HasSubstr("R: is no rotation matrix"));
  EXPECT_THAT(with("R", {2, 0, 0, 0, 2, 0, 0, 0, 2}), HasSubstr("R: is no rotation matrix"));
  EXPECT_THAT(with("R", {1, 0, 0, 1}), HasSubstr("R: holds neither"));
  EXPECT_THAT(with("T", {-0.2, 0, 0, 0}), HasSubstr("T: holds 4 numbers, not 3"));
  EXPECT_THAT(with("T", {0, 0, 0}), HasSubstr("baseline is zero"));
  EXPECT_THAT(with("imageSize1", {1360.5, 1024}), HasSubstr("image size"));
  EXPECT_THAT(with("imageSize1", {1e9, 1024}), HasSubstr("image size"));
  EXPECT_THAT(with("K3", good["K1"]), HasSubstr("holds the cameras 1, 2, 3"));
  Json halved = good;
  halved["cameraMatrix"] = good["K1"];
  halved["cameraMatrix2"] = good["K2"];
  for (const char* key : {"K1", "K2"}) halved.erase(key);
  EXPECT_THAT(refusal("bad.json", halved.dump()),
              HasSubstr("found cameraMatrix, cameraMatrix2; missing cameraMatrix1"));
}

TEST_F(CalibrationFiles, OpenCvsRationalLensesAreFollowed) {
  test::writeOpenCv(at("s.json"), rig_);
  Json file = Json::parse(test::readText(at("s.json")));
  const std::array<double, 8> d{0.14, 0.7, 0.005, -0.002, -0.3, 0.2, 0.3, -0.1};
  file["D1"] = d;
  const Calibration read = readCalibration(write("s.json", file.dump()));
  EXPECT_THAT(read.about, HasSubstr("rational lenses taken as k1 k2 p1 p2 k3, 0.0"));
  const Camera& c = read.rig.left;
  double most = 0;
  for (const double u : {0.0, 200.0, 700.0, 1359.0})
    for (const double v : {0.0, 300.0, 500.0, 1023.0}) {
      const Eigen::Vector2d n = c.undistort({u, v});
      const double x = n.x(), y = n.y(), q = n.squaredNorm();
      const double radial =
          (1 + q * (d[0] + q * (d[1] + q * d[4]))) / (1 + q * (d[5] + q * (d[6] + q * d[7])));
      const Eigen::Vector2d truth(x * radial + 2 * d[2] * x * y + d[3] * (q + 2 * x * x),
                                  y * radial + d[2] * (q + 2 * y * y) + 2 * d[3] * x * y);
      most = std::max(most, std::hypot(u - c.cx - c.fx * truth.x(), v - c.cy - c.fy * truth.y()));
    }
  EXPECT_GT(most, 0);
  EXPECT_LT(most, 0.01);
}

TEST_F(CalibrationFiles, ARealCalibrationOfOpenCvsSampleIsRead) {
  FATHOM_REQUIRE_DATA("calibration/intrinsics.yml");
  const Calibration read = readCalibration(test::dataFile("calibration/intrinsics.yml"), 0.001);
  EXPECT_NEAR(read.rig.left.fx, 518.05, 0.01);
  EXPECT_NEAR(read.rig.right.cx, 327.59, 0.01);
  EXPECT_NEAR(read.rig.baseline(), 0.0921, 0.0001);
  EXPECT_THAT(read.about, HasSubstr("rational lenses"));
}

TEST_F(CalibrationFiles, KalibrsCamchainIsRead) {
  const StereoRig rig = withoutK3(rig_);
  const std::string good = test::kalibrText(rig);
  EXPECT_EQ(readsAs(write("camchain.yaml", good), rig),
            "Kalibr camchain.yaml (left cam0, right cam1), baseline 0.305 m");
  StereoRig straight = rig;
  straight.left.k1 = straight.left.k2 = straight.left.p1 = straight.left.p2 = 0;
  const std::string coefficients = "distortion_coeffs: [0, 0, 0, 0]\n  distortion_model: ";
  const std::string none = test::kalibrText(straight);
  ASSERT_THAT(none, HasSubstr(coefficients + "radtan"));
  readsAs(write("none.yaml", replaced(none, coefficients + "radtan", "distortion_model: none")), straight);
}

TEST_F(CalibrationFiles, KalibrsOtherModelsAndNonsenseAreRefused) {
  const std::string good = test::kalibrText(rig_);
  const auto with = [&](const std::string& from, const std::string& to) {
    return refusal("camchain.yaml", replaced(good, from, to));
  };
  EXPECT_THAT(with("radtan", "equidistant"), HasSubstr("cam0.distortion_model: 'equidistant' is not known"));
  EXPECT_THAT(with("pinhole", "omni"), HasSubstr("cam0.camera_model: 'omni' is not known"));
  EXPECT_THAT(with("T_cn_cnm1", "T_cam_imu"), HasSubstr("cam1.T_cn_cnm1: is missing"));
  EXPECT_THAT(with("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 1.0]"), HasSubstr("holds 15 numbers, not 16"));
  EXPECT_THAT(with("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, .nan]"), HasSubstr("16 finite numbers"));
  EXPECT_THAT(with("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0, 2.0]"), HasSubstr("last row"));
  EXPECT_THAT(with("resolution: [1360, 1024]", "resolution: [1360]"), HasSubstr("cam0.resolution"));
  EXPECT_THAT(with("cam1:", "camera:"), HasSubstr("holds the cameras cam0;"));
  EXPECT_THAT(refusal("c.yaml", good + "cam2: {camera_model: pinhole}\n"), HasSubstr("cam0, cam1, cam2"));
  EXPECT_THAT(with("cam_overlaps: [1]", "cam_overlaps: [1"), AllOf(HasSubstr("line "), HasSubstr("YAML")));
  EXPECT_THAT(with("cam_overlaps: [1]", "cam_overlaps: *a"), HasSubstr("references"));
  EXPECT_THAT(refusal("deep.yaml", "cam0: " + std::string(1000, '[')), HasSubstr("nested too deeply"));
}

TEST_F(CalibrationFiles, WhatIsNoCalibrationIsNamedInOneCleanLine) {
  const std::string binary("II*\0\x08\x1b[2J", 9);
  EXPECT_THAT(refusal("image.tif", binary), HasSubstr("image.tif: is no text"));
  EXPECT_THAT(refusal("empty", " \n"), HasSubstr("is empty"));
  EXPECT_THAT(refusal(folder_.path()), HasSubstr("is no file"));
  EXPECT_THAT(refusal(at("absent.yml")), HasSubstr("absent.yml: is no file"));
  EXPECT_THAT(refusal("letter.txt", "Dear diver"), HasSubstr("no stereo calibration that is known"));
  EXPECT_THAT(refusal("a.json", "{\"K1\": "), HasSubstr("cannot be parsed as JSON"));
  EXPECT_THAT(refusal("a.xml", "<a><b></a>"), HasSubstr("cannot be parsed as XML"));
  EXPECT_THAT(refusal("a.json", std::string(100, '[')), HasSubstr("nested too deeply"));
  std::string deep;
  for (int k = 0; k < 100; ++k) deep += "<a>";
  for (int k = 0; k < 100; ++k) deep += "</a>";
  EXPECT_THAT(refusal("a.xml", deep), HasSubstr("nested too deeply"));
  EXPECT_EQ(refusal("x.yml", "\x1b[2J: [").find('\x1b'), std::string::npos);
}

TEST_F(CalibrationFiles, AFoldersOneCalibrationIsFound) {
  EXPECT_THAT(refusalOfFolder(), HasSubstr("no stereo calibration; give one with --calib"));
  write("notes.json", "{\"camera\": {\"K1\": 3}}");
  write("broken.yaml", "a: [");
  write("settings.yml", "%YAML:1.0\nimage_width: 3\n");
  write("report.xml", "<PAMDataset/>");
  write("readme.txt", test::colmapCameras(rig_));
  EXPECT_THAT(refusalOfFolder(), HasSubstr("no stereo calibration"));
  write("camchain.yaml", test::kalibrText(rig_));
  EXPECT_EQ(findCalibration(folder_.path()), at("camchain.yaml"));
  test::writeOpenCv(at("stereo.xml"), rig_);
  EXPECT_THAT(refusalOfFolder(), HasSubstr("several calibrations (camchain.yaml, stereo.xml); name one"));
  writeStereoCalib(at("stereo.calib"), rig_);
  EXPECT_EQ(findCalibration(folder_.path()), at("stereo.calib"));
}

TEST_F(CalibrationFiles, ACameraAboveTheOtherIsSaidToBeThere) {
  StereoRig upright = withoutK3(rig_);
  for (const auto& [down, word] : {std::pair(0.25, "below"), std::pair(-0.25, "above")}) {
    const Eigen::Matrix3d R = upright.T_right_left.matrix3();
    upright.T_right_left = SE3(upright.T_right_left.rotation(), -R * Eigen::Vector3d(-0.004, down, 0.001));
    const std::string about = readsAs(write("c.yaml", test::kalibrText(upright)), upright);
    EXPECT_THAT(about, HasSubstr(std::string("the right camera ") + word + " the left one"));
    EXPECT_THAT(about, Not(HasSubstr("to the left of")));
  }
}

TEST_F(CalibrationFiles, ARightCameraOnTheLeftIsSaid) {
  StereoRig crossed = withoutK3(rig_);
  crossed.T_right_left = crossed.T_right_left.inverse();
  EXPECT_THAT(readsAs(write("c.yaml", test::kalibrText(crossed)), crossed),
              HasSubstr("the right camera to the left of the left one"));
}

}  // namespace
}  // namespace fathom::topside
