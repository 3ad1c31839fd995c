#include <gmock/gmock.h>

#include <numbers>

#include "realtime/base/units.hpp"
#include "recon/import/navigation/nav_data.hpp"
#include "recon/solver/pose_graph.hpp"
#include "recon/topside/localise/known_places.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::topside {
namespace {

using testing::Contains, testing::HasSubstr;
constexpr std::int64_t kNoon = 1'708'171'200'000'000'000;  // 2024-02-17T12:00:00Z

class NavFiles : public testing::Test {
 protected:
  NavData read(const std::string& text, std::optional<std::int64_t> about = {}) {
    options_.files = {folder_.path() / "nav.txt"};
    test::writeText(options_.files[0], text);
    return readNavFiles(options_, about);
  }
  std::string refusal(const std::string& text) {
    return test::refusal([&] { (void)read(text); });
  }
  test::TemporaryFolder folder_;
  NavFileOptions options_;
};

// A sentence with its checksum.
std::string nmea(const std::string& sentence) {
  unsigned sum = 0;
  for (const char c : sentence) sum ^= static_cast<unsigned char>(c);
  char digits[8];
  std::snprintf(digits, sizeof digits, "*%02X\r\n", sum);
  return "$" + sentence + digits;
}

TEST_F(NavFiles, ColumnsAreKnownByTheirUsualNamesAndUnits) {
  const NavData data = read(
      "Timestamp,Lat [deg],lon_deg,Depth (cm),Heading_deg,roll_rad,Pitch [rad],Altitude,accuracy\n"
      "2024-02-17T12:00:00Z,-33.5,151.25,1234,90,0.1,-0.2,2.5,3\n"
      "2024-02-17T12:00:01Z,,,1240,,,,,\n");
  ASSERT_EQ(data.position.size(), 1u);
  EXPECT_EQ(data.position[0].utc_ns, kNoon);
  EXPECT_TRUE(data.position[0].value.isApprox(
      Eigen::Vector3d(-33.5 * kRadiansPerDegree, 151.25 * kRadiansPerDegree, 3)));
  ASSERT_EQ(data.depth.size(), 2u);
  EXPECT_NEAR(data.depth[1].value.x(), 12.40, 1e-12);
  EXPECT_NEAR(data.heading.at(0).value.x(), 90 * kRadiansPerDegree, 1e-12);
  EXPECT_TRUE(data.tilt.at(0).value.isApprox(Eigen::Vector3d(0.1, -0.2, 0)));
  EXPECT_EQ(data.altitude.at(0).value.x(), 2.5);
  EXPECT_THAT(data.assumed, Contains(HasSubstr("latitude (Lat [deg])")));
}

TEST_F(NavFiles, ColumnsThatAreNamedCountForMore) {
  options_.columns = "time=ms:ms,depth=z:ft,heading=h:rad,forward=vx:kn,starboard=vy:kn";
  const NavData data = read("ms;z;h;heading;vx;vy\n1708171200250;10;1;77;2;0\n");
  EXPECT_EQ(data.depth.at(0).utc_ns, kNoon + kSecond_ns / 4);
  EXPECT_NEAR(data.depth[0].value.x(), 3.048, 1e-12);
  EXPECT_EQ(data.heading.at(0).value.x(), 1);
  EXPECT_NEAR(data.velocity.at(0).value.x(), 2 * 1852.0 / 3600, 1e-12);
  options_.columns = "time=t:%d.%m.%Y %H:%M:%S";
  EXPECT_EQ(read("t,depth\n17.02.2024 12:00:05,1\n").depth.at(0).utc_ns, kNoon + 5 * kSecond_ns);
  options_.columns = "";
  EXPECT_EQ(read("date,time,depth\n2024-02-17,12:00:07,1\n").depth.at(0).utc_ns, kNoon + 7 * kSecond_ns);
}

TEST_F(NavFiles, EastingsAndNorthingsOfACrsArePlaces) {
  options_.crs = "EPSG:32756";
  const NavData data = read("time,easting,northing\n1708171200,337770.26,6251852.46\n");
  EXPECT_NEAR(data.position.at(0).value.x() / kRadiansPerDegree, -33.86, 0.01);
  EXPECT_NEAR(data.position[0].value.y() / kRadiansPerDegree, 151.24, 0.01);
  options_.crs = "EPSG:4326";
  EXPECT_THAT(refusal("time,easting,northing\n1708171200,1,2\n"), HasSubstr("no projected coordinate"));
}

TEST_F(NavFiles, EastingsAndNorthingsOfAnUnnamedProjectionAreBroughtNear) {
  const NavData data = read("time,easting,northing\n1708171200,337770.25,6251852.5\n");
  EXPECT_TRUE(data.local.at(0).value.isApprox(Eigen::Vector3d(-147.5, -229.75, 1)));
  EXPECT_THAT(data.assumed, Contains(HasSubstr("less 6252000 m north, 338000 m east")));
}

TEST_F(NavFiles, AGridOfOneSurveyIsBroughtNearToo) {
  const NavData data = read("time,east,north\n1708171200,66010.5,250\n");
  EXPECT_TRUE(data.local.at(0).value.isApprox(Eigen::Vector3d(250, 10.5, 1)));
  EXPECT_THAT(data.assumed, Contains(HasSubstr("less 0 m north, 66000 m east")));
}

TEST_F(NavFiles, PlacesThatNoVehicleReachesAreLeftOutAndCounted) {
  const NavData data = read(
      "time,lat,lon\n1708171200,0,0\n1708171201,-33.5,151.25\n1708171202,-33.5,151.25\n"
      "1708171203,-33.5001,151.25\n1708171204,33.5,151.25\n");
  EXPECT_EQ(data.position.size(), 3u);
  EXPECT_NEAR(originOf(data)->latitude / kRadiansPerDegree, -33.5, 1e-9);
  EXPECT_THAT(data.assumed,
              Contains("2 positions at 0 N 0 E or over 100 km from those before and after are left out"));
  EXPECT_THAT(refusal("time,lat,lon\n1708171200,0,0\n"), HasSubstr("holds no navigation"));
  std::string transit = "time,lat,lon\n";  // of a ship that came from far
  for (int k = 0; k <= 20; ++k)
    transit += std::to_string(1708171200 + 3600 * k) + ",-33," + std::to_string(150 + 0.2 * k) + "\n";
  EXPECT_EQ(read(transit).position.size(), 21u);
}

TEST_F(NavFiles, DepthsThatAreNegativeAreHeights) {
  const NavData data = read("time,depth\n1708171200,0.1\n1708171201,-12.5\n1708171202,-12.75\n");
  EXPECT_EQ(data.depth.at(1).value.x(), 12.5);
  EXPECT_EQ(data.depth.at(0).value.x(), -0.1);
  EXPECT_THAT(data.assumed, Contains("depths are negative below the surface"));
}

TEST_F(NavFiles, HemispheresAreRead) {
  for (const char* text :
       {"time,lat,lat_ns,lon,lon_ew\n1708171200,23.5,S,151.25,W\n",
        "time,Latitude,N/S,Longitude,E/W\n1708171200,23.5,South,151.25,west\n",
        "time,lat,lon\n1708171200,23.5 S,151.25W\n", "time,lat,lon\n1708171200,23 30.0 S,151 15.0 W\n",
        "time,lat,lon\n1708171200,\"S23°30'00\"\"\",\"151°15'0\"\"W\"\n",
        "time,lat,lon\n1708171200,-23.5,208.75\n"}) {
    const NavData data = read(text);
    ASSERT_EQ(data.position.size(), 1u) << text;
    EXPECT_NEAR(data.position[0].value.x() / kRadiansPerDegree, -23.5, 1e-9) << text;
    EXPECT_NEAR(data.position[0].value.y() / kRadiansPerDegree, -151.25, 1e-9) << text;
  }
  EXPECT_THAT(refusal("time,lat,lat_ns,lon\n1708171200,23.5,up,151\n"),
              HasSubstr("row 1: has 'up' where N or S"));
  EXPECT_THAT(refusal("time,lat,lon\n1708171200,23.5 x,151\n"),
              HasSubstr("row 1: has '23.5x' in column lat"));
}

TEST_F(NavFiles, TimesOfAnotherZoneAreBroughtToUtc) {
  for (const char* time : {"2024-02-17T22:00:00+10:00", "2024-02-17 07:30:00.000 -0430",
                           "2024-02-17T13:00:00+01", "2024-02-17T12:00:00Z", "2024-02-17T12:00:00"})
    EXPECT_EQ(read(std::string("time,depth\n") + time + ",1\n").depth.at(0).utc_ns, kNoon) << time;
  EXPECT_EQ(read("date,time,depth\n2024-02-18,01:00:00+13:00,1\n").depth.at(0).utc_ns, kNoon);
}

TEST_F(NavFiles, VelocitiesThatMayBeOfTheBodyOrOfTheEarthAreLeftOutUntilSomebodySays) {
  const std::string text = "time,depth,u,v,w\n1708171200,1,0.5,0.25,0\n";
  const NavData data = read(text);
  EXPECT_TRUE(data.velocity.empty() && data.track.empty());
  EXPECT_THAT(data.assumed, Contains(HasSubstr("--nav-columns velocity_east=u,velocity_north=v")));
  options_.columns = "velocity_east=u,velocity_north=v";
  EXPECT_TRUE(read(text).track.at(0).value.isApprox(Eigen::Vector3d(0.25, 0.5, 0)));
  options_.columns = "forward=u,starboard=v";
  EXPECT_TRUE(read(text).velocity.at(0).value.isApprox(Eigen::Vector3d(0.5, 0.25, 0)));
  options_.columns = "";
  EXPECT_THAT(refusal("time,u,v\n1708171200,1,2\n"), HasSubstr("velocity_east=u"));
}

TEST_F(NavFiles, NonsenseIsRefusedByItsPlace) {
  EXPECT_THAT(refusal("deep,depth\n1,1\n"), HasSubstr("no column of times"));
  EXPECT_THAT(refusal("time,depth\nnoon,1\n"), HasSubstr("row 1: has no time 'noon'"));
  EXPECT_THAT(refusal("time,depth\n1708171200,deep\n"), HasSubstr("row 1: has 'deep' in column depth"));
  EXPECT_THAT(refusal("time,lat,lon\n1708171200,6251852,337770\n"), HasSubstr("not on Earth"));
  EXPECT_THAT(refusal("time,banana\n1708171200,1\n"), HasSubstr("holds no navigation"));
  options_.columns = "time=clock";
  EXPECT_THAT(refusal("time,depth\n1708171200,1\n"), HasSubstr("no column 'clock'; there are: time, depth"));
  options_.columns = "depht=depth";
  EXPECT_THAT(refusal("time,depth\n1708171200,1\n"), HasSubstr("with one of: time, date, latitude"));
  options_.columns = "depth=depth:kn";
  EXPECT_THAT(refusal("time,depth\n1708171200,1\n"), HasSubstr("a unit that is not known for depth"));
}

TEST_F(NavFiles, SentencesOfNmea0183AreRead) {
  options_.declination = 12 * kRadiansPerDegree;
  const NavData data = read(nmea("GPZDA,120000.00,17,02,2024,00,00") +
                            nmea("GPGGA,120000.50,3352.000,S,15112.000,E,1,8,1.0,0,M,0,M,,") +
                            nmea("HEHDT,350.0,T") + nmea("HCHDM,10.0,M") + nmea("SDDBT,8.2,f,2.5,M,1.4,F") +
                            nmea("YXXDR,A,2.0,D,PITCH,A,-1.0,D,ROLL") + nmea("VDVBW,0,0,V,1.0,0.5,A") +
                            "$HEHDT,123.0,T*00\r\n");
  EXPECT_NEAR(data.position.at(0).value.x() / kRadiansPerDegree, -(33 + 52.0 / 60), 1e-12);
  EXPECT_EQ(data.position[0].utc_ns, kNoon + kSecond_ns / 2);
  ASSERT_EQ(data.heading.size(), 1u) << "of one time one heading, and none with a wrong checksum";
  EXPECT_NEAR(data.heading[0].value.x(), 350 * kRadiansPerDegree, 1e-12);
  EXPECT_EQ(data.altitude.at(0).value.x(), 2.5);
  EXPECT_TRUE(data.tilt.at(0).value.isApprox(Eigen::Vector3d(-kRadiansPerDegree, 2 * kRadiansPerDegree, 0)));
  EXPECT_NEAR(data.velocity.at(0).value.y(), 0.5 * 1852 / 3600, 1e-12);
  EXPECT_THAT(data.assumed, Contains(HasSubstr("1 with a wrong checksum")));
}

TEST_F(NavFiles, ATimeOfDayIsOfTheDayOfTheImages) {
  const std::string text = nmea("GPGGA,235959.00,3352.0,S,15112.0,E,1,8,1.0,0,M,0,M,,") +
                           nmea("GPGGA,000001.00,3352.0,S,15112.0,E,1,8,1.0,0,M,0,M,,");
  const std::int64_t midnight = kNoon + 12 * 3600 * kSecond_ns;
  const NavData data = read(text, midnight + 5 * kSecond_ns);
  ASSERT_EQ(data.position.size(), 2u);
  EXPECT_EQ(data.position[0].utc_ns, midnight - kSecond_ns);
  EXPECT_EQ(data.position[1].utc_ns, midnight + kSecond_ns);
  EXPECT_THAT(refusal(text), HasSubstr("times of day without a date"));
}

TEST_F(NavFiles, ALoggersOwnTimeIsTakenBeforeTheSentences) {
  const NavData data = read("2024-02-17T12:00:03.250Z " + nmea("HEHDT,10.0,T"));
  EXPECT_EQ(data.heading.at(0).utc_ns, kNoon + 3 * kSecond_ns + kSecond_ns / 4);
}

TEST_F(NavFiles, AreKnownBetweenTheirRowsAndNotFarFromThem) {
  options_.columns = "heading=h";
  const NavData data = read(
      "time,lat,lon,depth,h,forward,starboard\n1708171200,-33,151,10,359,1,0\n"
      "1708171202,-33,151,12,1,1,0\n1708171232,-33,151,12,1,1,0\n");
  const Geodetic origin = *originOf(data);
  const auto known =
      knownAt(data, origin, {kNoon, kNoon + kSecond_ns, kNoon + 2 * kSecond_ns, kNoon + 20 * kSecond_ns});
  EXPECT_NEAR(*known[1].depth, 11, 1e-12);
  EXPECT_NEAR(*known[1].heading, 0, 1e-12) << "359 and 1 degrees";
  EXPECT_EQ(known[1].sigma, 1);
  EXPECT_LT(known[1].north_east->norm(), 1e-6);
  EXPECT_NEAR(known[2].moved->x(), 1, 1e-3);
  EXPECT_FALSE(known[0].moved.has_value());
  EXPECT_FALSE(known[3].depth.has_value());
  EXPECT_FALSE(known[3].moved.has_value());
}

// A vehicle that looks down on level ground and goes round a square, seen from a frame turned at will.
class Square : public testing::Test {
 protected:
  void SetUp() override {
    Eigen::Matrix3d down;
    down << 0, -1, 0, 1, 0, 0, 0, 0, 1;
    T_body_cam_ = SE3(down, Eigen::Vector3d::Zero());
    for (int k = 0; k < 40; ++k) {
      const double along = k % 10, side = k / 10;
      const double heading = side * std::numbers::pi / 2;
      const Eigen::Vector3d corner(side == 1 || side == 2 ? 10 : 0, side >= 2 ? 10 : 0, 5);
      const Eigen::Vector3d place = corner + along * Eigen::Vector3d(std::cos(heading), std::sin(heading), 0);
      truth_.push_back(SE3::fromEuler(0.02, -0.03, heading, place) * T_body_cam_);
      all_.push_back(static_cast<std::uint32_t>(k));
      ground_.push_back(truth_.back().rotation().conjugate() * Eigen::Vector3d::UnitZ());
    }
    const SE3 elsewhere = SE3::fromEuler(0.7, -0.4, 2, {100, -50, 3});
    for (const SE3& pose : truth_) poses_.push_back(elsewhere * pose);
    known_.resize(truth_.size());
  }
  [[nodiscard]] double worst(std::span<const SE3> poses) const {
    double most = 0;
    for (std::size_t k = 0; k < poses.size(); ++k)
      most = std::max(most, (poses[k].translation() - truth_[k].translation()).norm());
    return most;
  }
  [[nodiscard]] KnownPlaces places(bool mounted = false) const {
    return {known_, ground_, T_body_cam_, mounted};
  }
  [[nodiscard]] double worstMoved(const KnownPlaces& places) const {
    const SE3 T = places.motionOf(all_, poses_).T_nav_part;
    std::vector<SE3> moved;
    for (const SE3& pose : poses_) moved.push_back(T * pose);
    return worst(moved);
  }

  SE3 T_body_cam_;
  std::vector<std::uint32_t> all_;
  std::vector<SE3> truth_, poses_;
  std::vector<Eigen::Vector3d> ground_;
  std::vector<KnownPose> known_;
};

TEST_F(Square, PositionsAndDepthsAloneTellWhereAPartIs) {
  for (std::size_t k = 0; k < truth_.size(); k += 3) {
    known_[k].north_east = truth_[k].translation().head<2>();
    known_[k].sigma = 0.1;
    known_[k].depth = 5;
  }
  EXPECT_LT(worstMoved(places()), 1e-9);
}

TEST_F(Square, AnAttitudeAndAPositionDoToo) {
  known_[7].north_east = truth_[7].translation().head<2>();
  known_[7].sigma = 1;
  known_[11].depth = 5;
  known_[15].heading = std::numbers::pi / 2;
  known_[15].tilt = Eigen::Vector2d(0.02, -0.03);
  EXPECT_LT(worstMoved(places()), 1e-9);
}

TEST_F(Square, AttitudesOfACameraThatLooksAsideAreRefusedUnlessSomebodySaysHowItLooks) {
  for (KnownPose& one : known_) one.tilt = Eigen::Vector2d(0.02, 0.9);
  ASSERT_TRUE(places().refusedTilt().has_value());
  EXPECT_NEAR(*places().refusedTilt(), 0.93, 0.001);
  EXPECT_FALSE(places(true).refusedTilt().has_value());
}

TEST_F(Square, PositionsImproveADriftingChainAndWildOnesAreLeftOut) {
  slam::PoseGraph graph;
  graph.poses = {truth_[0]};
  const Matrix6d information = slam::residualInformation(
      Matrix6d((Vector6d() << 1e4, 1e4, 1e4, 1e4, 1e4, 1e4).finished().asDiagonal()));
  const SE3 drift = SE3::fromEuler(0, 0, 0.01, {0.01, 0, 0});
  for (int k = 1; k < 40; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const SE3 step = truth_[at - 1].inverse() * truth_[at] * drift;
    graph.edges.push_back({k - 1, k, step, information});
    graph.poses.push_back(graph.poses.back() * step);
  }
  ASSERT_GT(worst(graph.poses), 1.5);
  for (std::size_t k = 0; k < truth_.size(); ++k) {
    known_[k].north_east = truth_[k].translation().head<2>();
    known_[k].sigma = 0.3;
    known_[k].depth = 5;
    known_[k].tilt = Eigen::Vector2d(0.02, -0.03);
  }
  *known_[20].north_east += Eigen::Vector2d(30, 0);
  KnownPlaces known = places();
  const std::vector<std::uint32_t> firsts{0};
  const KnownPlaces::Placed placed = known.improved(graph, firsts);
  EXPECT_TRUE(placed.converged);
  EXPECT_EQ(known.positionsLeftOut(), 1u);
  EXPECT_EQ(known.positionsKept(), 39u);
  EXPECT_LT(worst({placed.graph.poses.begin() + 1, placed.graph.poses.end()}), 0.4);
}

TEST_F(Square, VelocitiesBridgeAStep) {
  known_[4].heading = known_[5].heading = 0;
  known_[4].tilt = known_[5].tilt = Eigen::Vector2d(0.02, -0.03);
  known_[5].moved = Eigen::Vector3d(1, 0, 0);
  const auto step = places().stepTo(5);
  ASSERT_TRUE(step.has_value());
  EXPECT_LT((step->T_a_b.inverse() * truth_[4].inverse() * truth_[5]).log().norm(), 1e-9);
  EXPECT_FALSE(places().stepTo(6).has_value());
}

}  // namespace
}  // namespace fathom::topside
