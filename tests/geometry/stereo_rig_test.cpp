#include "recon/geometry/stereo_rig.hpp"

#include <gtest/gtest.h>

#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

using test::TemporaryFolder;

StereoRig surveyRig() {
  const Camera c{1360, 1024, 1710.0, 1708.0, 690.0, 499.0, 0.136, 0.734, 0.005, 0.002, 0};
  return {c, c, SE3::fromEuler(0.001, 0.004, -0.002, {-0.0695, -0.0001, -0.0007})};
}

std::filesystem::path calibFile(const TemporaryFolder& folder, const std::string& text) {
  const auto path = folder.path() / "stereo.calib";
  test::writeText(path, text);
  return path;
}

std::string calibRefusal(const std::filesystem::path& path) {
  return test::refusal([&] { (void)readStereoCalib(path); });
}

TEST(StereoCalib, ReadsTheRealRig) {
  FATHOM_REQUIRE_DATA("acfr/ng2_20070520_subset1.calib");
  const StereoRig rig = readStereoCalib(test::dataFile("acfr/ng2_20070520_subset1.calib"));
  EXPECT_EQ(rig.left.width, 1360);
  EXPECT_NEAR(rig.left.fx, 1711.82, 0.005);
  EXPECT_NEAR(rig.right.fx, 1712.22, 0.005);
  EXPECT_NEAR(rig.left.k1, 0.135773, 1e-9);
  EXPECT_NEAR(rig.left.k2, 0.734495, 1e-9);
  EXPECT_NEAR(rig.baseline(), 0.06949, 1e-5);
}

TEST(StereoCalib, RoundTripsWithAndWithoutTheThirdRadialTerm) {
  const TemporaryFolder folder;
  for (const double k3 : {0.0, -0.25}) {
    StereoRig rig = surveyRig();
    rig.right.k3 = k3;
    writeStereoCalib(folder.path() / "stereo.calib", rig);
    const StereoRig in = readStereoCalib(folder.path() / "stereo.calib");
    EXPECT_EQ(in.right.k3, k3);
    EXPECT_EQ(in.left.fy, rig.left.fy);
    EXPECT_LT((in.T_right_left.inverse() * rig.T_right_left).log().norm(), 1e-9);
  }
}

TEST(StereoCalib, RefusesBadFilesNamingTheNumber) {
  const TemporaryFolder folder;
  EXPECT_NE(calibRefusal(folder.path() / "absent.calib"), "");
  EXPECT_NE(calibRefusal(calibFile(folder, "")).find("holds 0 numbers"), std::string::npos);
  EXPECT_NE(calibRefusal(calibFile(folder, "2 1360 1024 17")).find("holds 4 numbers"), std::string::npos);
  EXPECT_NE(calibRefusal(calibFile(folder, "2 1360 fish")).find("number 3"), std::string::npos);
  EXPECT_NE(calibRefusal(calibFile(folder, "2 1360 nan")).find("number 3"), std::string::npos);

  writeStereoCalib(folder.path() / "good.calib", surveyRig());
  const std::string good = test::readText(folder.path() / "good.calib");
  EXPECT_EQ(calibRefusal(calibFile(folder, good)), "");
  EXPECT_NE(calibRefusal(calibFile(folder, "3" + good.substr(1))).find("number of cameras"),
            std::string::npos);
  EXPECT_NE(calibRefusal(calibFile(folder, "2\n-5" + good.substr(6))).find("image size"), std::string::npos);
}

TEST(Triangulation, MidpointRecoversAPointFromTwoDistortedCameras) {
  const StereoRig rig = surveyRig();
  const Eigen::Vector3d truth(0.3, -0.2, 2.1);
  Eigen::Vector3d point;
  double gap = 1;
  ASSERT_TRUE(triangulateMidpoint(rig, rig.left.ray(rig.left.project(truth)),
                                  rig.right.ray(rig.right.project(rig.T_right_left * truth)), point, gap));
  EXPECT_LT((point - truth).norm(), 1e-6);
  EXPECT_LT(gap, 1e-8);
}

TEST(Triangulation, ParallelAndDivergingRaysGiveNoPoint) {
  const StereoRig rig = surveyRig();
  Eigen::Vector3d point;
  double gap = 0;
  const Eigen::Vector3d ray(0, 0, 1);
  EXPECT_FALSE(triangulateMidpoint(rig, ray, rig.T_right_left.rotation() * ray, point, gap));
  EXPECT_FALSE(triangulateMidpoint(rig, {-0.1, 0, 1}, {0.1, 0, 1}, point, gap));
}

}  // namespace
}  // namespace fathom
