#include "firmware_if/mission/pose_files.hpp"

#include <gmock/gmock.h>

#include "realtime/base/units.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::readText, test::refusal, test::replaced, test::writeText, ::testing::AllOf;
using ::testing::HasSubstr;

// As the ACFR's pipeline writes it (fields in columns, comments between).
constexpr const char* kStereo =
    "% STEREO_POSE_FILE VERSION 2\n"
    "%\n"
    "% produced by seabed_slam\n"
    "ORIGIN_LATITUDE  -14.126500000000\n"
    "ORIGIN_LONGITUDE 121.866400000000\n"
    "0 1239866302.8530 -14.1264096 121.8664926 10.0 -20.0 30.0 0.0 0.0 1.5707963267948966 "
    "PR_20090416_071822_853_LC16.png PR_20090416_071822_853_RM16.png 2.1 1.5 1\r\n"
    "  7\t1239866303.8530\t-14.1264\t121.8665\t1e1\t+2\t3.5\t0.1\t-0.2\t-3.0\tl.png\tr.png\t0\t0\t0\n";

class PoseFilesTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::string refusalOf(const std::string& text) const {
    writeText(path_, text);
    return refusal([&] { (void)readStereoPoses(path_); });
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_.path() / "poses.data";
};

TEST_F(PoseFilesTest, ANameWithBlanksComesBackAsItWas) {
  const StereoPoseFile file{{}, {{1, 5.0, SE3(), "GoPro 1 left.jpg", "50%25 of \t1.jpg", 2, 1, false}}};
  writeStereoPoses(path_, file);
  EXPECT_THAT(readText(path_), HasSubstr("\tGoPro%201%20left.jpg\t50%2525%20of%20%091.jpg\t"));
  const StereoPoseFile read = readStereoPoses(path_);
  EXPECT_EQ(read.poses[0].left_image, "GoPro 1 left.jpg");
  EXPECT_EQ(read.poses[0].right_image, "50%25 of \t1.jpg");
}

TEST_F(PoseFilesTest, AnAcfrStereoFileIsReadFieldByField) {
  writeText(path_, kStereo);
  const StereoPoseFile file = readStereoPoses(path_);
  EXPECT_DOUBLE_EQ(file.origin.latitude * kDegreesPerRadian, -14.1265);
  EXPECT_DOUBLE_EQ(file.origin.longitude * kDegreesPerRadian, 121.8664);
  ASSERT_EQ(file.poses.size(), 2u);
  const StereoPose& pose = file.poses[0];
  EXPECT_EQ(pose.utc_s, 1239866302.8530);
  EXPECT_EQ(pose.T_nav_cam.translation(), Eigen::Vector3d(10, -20, 30));
  // Heading east: the frame's x axis points east, its y axis south.
  EXPECT_LT((pose.T_nav_cam.rotation() * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  EXPECT_LT((pose.T_nav_cam.rotation() * Eigen::Vector3d::UnitY() + Eigen::Vector3d::UnitX()).norm(), 1e-12);
  EXPECT_EQ(pose.left_image, "PR_20090416_071822_853_LC16.png");
  EXPECT_EQ(pose.right_image, "PR_20090416_071822_853_RM16.png");
  EXPECT_EQ(pose.altitude, 2.1);
  EXPECT_EQ(pose.footprint_radius, 1.5);
  EXPECT_TRUE(pose.likely_crossover);
  EXPECT_EQ(file.poses[1].id, 7);
  EXPECT_FALSE(file.poses[1].likely_crossover);
  EXPECT_LT((file.poses[1].T_nav_cam.euler() - Eigen::Vector3d(0.1, -0.2, -3.0)).norm(), 1e-12);
}

TEST_F(PoseFilesTest, WrittenPosesComeBackWithTheirPlaceOnTheGlobe) {
  StereoPoseFile file{.origin = {-14.1265 / kDegreesPerRadian, 121.8664 / kDegreesPerRadian}, .poses = {}};
  file.poses.push_back({3, 1239866302.853, SE3::fromEuler(0.1, -0.2, 3.1, {1.5, -200.25, 30.0}), "l.tif",
                        "r.tif", 2.1, 1.5, true});
  writeStereoPoses(path_, file);
  const StereoPoseFile read = readStereoPoses(path_);
  ASSERT_EQ(read.poses.size(), 1u);
  EXPECT_EQ(read.poses[0].utc_s, file.poses[0].utc_s);
  EXPECT_EQ(read.poses[0].T_nav_cam.translation(), file.poses[0].T_nav_cam.translation());
  EXPECT_LT((read.poses[0].T_nav_cam.inverse() * file.poses[0].T_nav_cam).log().norm(), 1e-12);
  EXPECT_EQ(read.poses[0].left_image, "l.tif");

  std::istringstream lines(readText(path_));
  std::string line;
  while (std::getline(lines, line) && (line[0] == '%' || line[0] == 'O')) continue;
  std::istringstream fields(line);
  double id, time, latitude, longitude;
  fields >> id >> time >> latitude >> longitude;
  const Eigen::Vector2d local = LocalTransverseMercator(file.origin)
                                    .toLocal({latitude / kDegreesPerRadian, longitude / kDegreesPerRadian});
  EXPECT_NEAR(local.x(), 1.5, 1e-6);
  EXPECT_NEAR(local.y(), -200.25, 1e-6);

  VehiclePoseFile vehicle{.origin = file.origin, .poses = {}};
  vehicle.poses.push_back({1, 5.25, file.poses[0].T_nav_cam, 0.5});
  writeVehiclePoses(path_, vehicle);
  EXPECT_THAT(readText(path_), HasSubstr("% VEHICLE_POSE_FILE VERSION 3\n"));
  const VehiclePoseFile again = readVehiclePoses(path_);
  ASSERT_EQ(again.poses.size(), 1u);
  EXPECT_EQ(again.poses[0].altitude, 0.5);
  EXPECT_LT((again.poses[0].T_nav_body.inverse() * vehicle.poses[0].T_nav_body).log().norm(), 1e-12);
}

TEST_F(PoseFilesTest, WrittenCovariancesComeBack) {
  PoseCovariance pose{.left_image = "l 1.tif"};
  for (int i = 0; i < 6; ++i)
    for (int j = i; j < 6; ++j)
      pose.covariance(i, j) = pose.covariance(j, i) = std::pow(-0.1, i + 1) * (10 * i + j + 1.0 / 3.0);
  writePoseCovariances(path_, {pose, pose});
  const std::vector<PoseCovariance> read = readPoseCovariances(path_);
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[1].left_image, pose.left_image);
  EXPECT_EQ(read[1].covariance, pose.covariance);

  const std::string good = readText(path_);
  const auto refused = [&](const std::string& from, const std::string& to) {
    std::ofstream(path_) << replaced(good, from, to);
    return refusal([&] { (void)readPoseCovariances(path_); });
  };
  EXPECT_THAT(refused("north_east", "east_north"), AllOf(HasSubstr("line 1"), HasSubstr("north_east")));
  EXPECT_THAT(refused("l 1.tif,", "l 1.tif,0,"),
              AllOf(HasSubstr("line 2"), HasSubstr("has 23 fields; a covariance has 22")));
  EXPECT_THAT(refused("l 1.tif,-0.0", "l 1.tif,nan"), AllOf(HasSubstr("line 2"), HasSubstr("field 2")));
}

TEST_F(PoseFilesTest, APoseThatLooksStraightAheadKeepsItsAttitude) {
  // The Euler angles are singular at a pitch of a quarter turn.
  for (const double pitch : {std::numbers::pi / 2, -std::numbers::pi / 2}) {
    VehiclePoseFile file;
    file.poses.push_back({0, 1, SE3::fromEuler(0.3, pitch, 0.8, {0, 0, 0}), 0});
    writeVehiclePoses(path_, file);
    const SE3 read = readVehiclePoses(path_).poses[0].T_nav_body;
    EXPECT_LT((read.inverse() * file.poses[0].T_nav_body).log().norm(), 1e-7);
  }
}

TEST_F(PoseFilesTest, AMistakeIsRefusedWithItsLineAndField) {
  EXPECT_THAT(refusalOf(replaced(kStereo, "VERSION 2", "VERSION 1")),
              AllOf(HasSubstr("line 1"), HasSubstr("no latitude and longitude")));
  EXPECT_THAT(refusalOf(replaced(kStereo, "VERSION 2", "VERSION 9")), HasSubstr("version 2 is read"));
  EXPECT_THAT(refusalOf(replaced(kStereo, "STEREO", "VEHICLE")), HasSubstr("line 1: is not"));
  EXPECT_THAT(refusalOf(replaced(kStereo, "30.0", "deep")),
              AllOf(HasSubstr("line 6"), HasSubstr("field 7 (Z) is 'deep'")));
  EXPECT_THAT(refusalOf(replaced(kStereo, "30.0", "nan")), HasSubstr("field 7"));
  EXPECT_THAT(refusalOf(replaced(kStereo, " 2.1 1.5 1", " 2.1 1.5")),
              HasSubstr("has 14 fields; a pose has 15"));
  EXPECT_THAT(refusalOf(replaced(kStereo, "1.5 1\r", "1.5 2\r")), HasSubstr("likely crossover"));
  EXPECT_THAT(refusalOf(replaced(kStereo, "l.png", "../l.png")), HasSubstr("file in img/"));
  EXPECT_THAT(refusalOf(replaced(kStereo, "ORIGIN_LATITUDE", "ORIGIN_ALTITUDE")),
              HasSubstr("line 4: is unknown"));
  EXPECT_THAT(refusalOf(replaced(kStereo, "ORIGIN_LONGITUDE 121.866400000000\n", "")),
              HasSubstr("comes before"));
  EXPECT_THAT(refusalOf("% STEREO_POSE_FILE VERSION 2\n"), HasSubstr("has no ORIGIN_LATITUDE"));
}

TEST_F(PoseFilesTest, AbsentEmptyAndCutFilesAreRefused) {
  EXPECT_THAT(refusal([&] { (void)readStereoPoses(path_); }), HasSubstr("is absent"));
  EXPECT_THAT(refusalOf(""), HasSubstr("is empty"));
  const std::string whole = kStereo;
  for (std::size_t size = 1; size < whole.size(); ++size) {
    if (whole[size - 1] == '\n' && size > whole.find("121.8664")) continue;  // whole lines: a shorter file
    EXPECT_NE(refusalOf(whole.substr(0, size)), "") << "cut at " << size;
  }
}

TEST_F(PoseFilesTest, NumbersThatAreNoneAreNotWritten) {
  VehiclePoseFile file;
  file.poses.push_back({0, std::nan(""), SE3(), 0});
  EXPECT_ANY_THROW(writeVehiclePoses(path_, file));
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(PoseFilesTest, ATrajectoryComesBackToTheNanosecondAndTheBit) {
  const std::vector<TrajectoryPoint> points = {
      {1'700'000'000'123'456'789, SE3::fromEuler(0.1, 0.2, 0.3, {1.1, 2.2, 3.3})},
      {1'700'000'000'123'456'790, SE3::fromEuler(-0.1, 0.2, -3.1, {1e-9, -2.2, 3.3})}};
  writeTrajectory(path_, points);
  const auto read = readTrajectory(path_);
  ASSERT_EQ(read.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(read[i].utc_ns, points[i].utc_ns);
    EXPECT_EQ(read[i].pose.translation(), points[i].pose.translation());
    EXPECT_LT((read[i].pose.rotation().coeffs() - points[i].pose.rotation().coeffs()).norm(), 1e-15);
  }
}

TEST_F(PoseFilesTest, ATrajectoryWithAMistakeIsRefusedWithItsLine) {
  const std::string good = "utc_ns,north_m,east_m,depth_m,qw,qx,qy,qz\n5,1,2,3,1,0,0,0\n6,1,2,3,1,0,0,0\n";
  const auto refused = [&](const std::string& text) {
    writeText(path_, text);
    return refusal([&] { (void)readTrajectory(path_); });
  };
  EXPECT_EQ(refused(good), "");
  EXPECT_THAT(refused(replaced(good, "\n6,", "\n5,")), HasSubstr("line 3: is not later"));
  EXPECT_THAT(refused(replaced(good, "3,1,0", "3,2,0")), HasSubstr("line 2: field 5 (qw)"));
  EXPECT_THAT(refused(replaced(good, "3,1,0", "3,0,0")), HasSubstr("not of length 1"));
  EXPECT_THAT(refused(replaced(good, "5,1,2,3", "5,1,,3")), HasSubstr("field 3"));
  EXPECT_THAT(refused(replaced(good, "5,1,2,3", "5.5,1,2,3")), HasSubstr("utc_ns"));
  EXPECT_THAT(refused(replaced(good, "5,1,2,3", "5,1,2")), HasSubstr("has 7 fields"));
  EXPECT_THAT(refused(replaced(good, "utc_ns", "t")), HasSubstr("line 1"));
  EXPECT_THAT(refused(good.substr(0, good.size() - 1)), HasSubstr("was cut"));
}

}  // namespace
}  // namespace fathom::io
