#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "realtime/base/units.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"
#include "recon/topside/localise/control_network.hpp"
#include "recon/topside/pipeline.hpp"
#include "recon/topside/report/control_report.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/missions.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr;

// Control points, check points and scale bars: their tables, and what they do to a network.

constexpr double kDepth = 12, kCamera = 10;     // of level ground, of cameras over it [m]
constexpr double kShort = 1.007;                // lengths are, over what the images have
constexpr double kPixel = 0.5, kSurvey = 0.01;  // errors [px], [m]

// Level ground, seen on a lattice in each image, by a rig whose ranges are too short.
struct LevelGround final : FeatureStore {
  StereoRig rig = test::TinyMission::rig();
  [[nodiscard]] std::size_t count(std::size_t) const override { return 25; }
  void load(std::size_t, closure::FrameFeatures& out) const override {
    out.features.clear();
    for (int x = 0; x < 5; ++x)
      for (int y = 0; y < 5; ++y) {
        closure::Feature f{};
        f.left = {30 + 70 * x, 20 + 54 * y};
        const Eigen::Vector3d point = rig.left.ray(f.left.cast<double>()) * ((kDepth - kCamera) / kShort);
        f.point = point.cast<float>();
        f.right = rig.right.project(rig.T_right_left * point).cast<float>();
        out.features.push_back(f);
      }
  }
};

// A lawnmower of level cameras; what images know of it stands anywhere, turned, and is too small.
struct ControlSurvey {
  LevelGround ground;
  Frames frames;
  std::vector<SE3> truth, seen;
  ControlPoints control;
  std::vector<ControlSighting> sightings;
  std::vector<Eigen::Vector3d> places;  // in truth, of the points
  slam::PoseGraph graph;
  std::mt19937 random{7};
  std::normal_distribution<double> gauss;

  ControlSurvey() {
    const SE3 anywhere = SE3::fromEuler(0.06, -0.04, 2, {30, -20, 4});
    for (int line = 0; line < 7; ++line)
      for (int k = 0; k < 12; ++k) {
        const int along = line % 2 == 0 ? k : 11 - k;
        truth.push_back(SE3::fromEuler(0, 0, line % 2 == 0 ? 0 : M_PI, {0.4 * along, 0.7 * line, kCamera}));
        const SE3 place = anywhere * truth.back();
        seen.emplace_back(place.rotation(), place.translation() / kShort);
        frames.pair.push_back(static_cast<std::uint32_t>(frames.pair.size()));
        frames.range.push_back((kDepth - kCamera) / kShort);
      }
    frames.features = &ground;
  }

  std::uint32_t add(const Eigen::Vector2d& north_east, bool surveyed, bool check) {
    const auto number = static_cast<std::uint32_t>(control.points.size());
    places.emplace_back(north_east.x(), north_east.y(), kDepth);
    ControlPoints::Point& point = control.points.emplace_back();
    point.name = (check ? "C" : "P") + std::to_string(number);
    point.sigma.setConstant(kSurvey);
    point.check = check;
    if (surveyed)
      point.place = places.back() + Eigen::Vector3d(gauss(random), gauss(random), gauss(random)) * kSurvey;
    for (std::uint32_t k = 0; k < truth.size(); ++k) {
      const Eigen::Vector2d pixel = ground.rig.left.project(truth[k].inverse() * places.back());
      if (pixel.x() < 5 || pixel.y() < 5 || pixel.x() > 335 || pixel.y() > 250) continue;
      sightings.push_back(
          {number, k, true, pixel + Eigen::Vector2d(gauss(random), gauss(random)) * kPixel, kPixel});
    }
    return number;
  }
  void addUsual() {
    for (const Eigen::Vector2d& at :
         {Eigen::Vector2d(0.2, 0.3), {4.2, 0.2}, {4.1, 4.0}, {0.3, 3.9}, {2.2, 2.1}})
      (void)add(at, true, false);
    for (const Eigen::Vector2d& at : {Eigen::Vector2d(1.2, 1), {3.2, 1.2}, {3, 3.3}, {1, 3}, {2.2, 0.5}})
      (void)add(at, true, true);
  }

  ControlResult adjusted() {
    ControlNetwork network(control, sightings, ground.rig, frames);
    const std::vector<std::vector<std::uint32_t>> parts = {frames.pair};
    const double scale = network.scaleAt(parts, seen);
    std::vector<SE3> poses = seen;
    for (SE3& pose : poses) pose = SE3(pose.rotation(), scale * pose.translation());
    const SE3 motion = network.motionOf(frames.pair, poses, true).value_or(SE3());
    graph = {};
    graph.ids = {0};
    graph.poses = {SE3()};
    ControlNetwork::Solved solved{&graph, {}, 0, {}, 0.004, scale};
    for (const SE3& pose : poses) {
      solved.nodes.push_back(static_cast<int>(graph.poses.size()));
      graph.ids.push_back(static_cast<std::int64_t>(graph.poses.size()));
      graph.poses.push_back(motion * pose);
    }
    Vector6d variance;
    variance << Eigen::Vector3d::Constant(1e-6), Eigen::Vector3d::Constant(1e-7);
    const auto link = [&](std::size_t a, std::size_t b) {
      solved.visual.push_back(graph.edges.size());
      graph.edges.push_back(slam::linkFactor(solved.nodes[a], solved.nodes[b], seen[a].inverse() * seen[b],
                                             variance.asDiagonal()));
    };
    for (std::size_t k = 0; k + 1 < seen.size(); ++k) link(k, k + 1);
    for (std::size_t k = 0; k + 12 < seen.size(); ++k) link(k, (k / 12 + 2) * 12 - 1 - k % 12);
    graph.edges.push_back(slam::linkFactor(0, 1, graph.poses[1], Matrix6d::Identity() * 1e4));
    return network.adjust(solved);
  }
  [[nodiscard]] double farthest() const {
    double most = 0;
    for (std::size_t k = 0; k < truth.size(); ++k)
      most = std::max(most, (graph.poses[k + 1].translation() - truth[k].translation()).norm());
    return most;
  }
};

TEST(ControlNetwork, FivePointsPlaceTurnAndScaleADiveWhoseChecksAreWhereTheyAreClaimed) {
  ControlSurvey survey;
  survey.addUsual();
  const ControlResult result = survey.adjusted();
  EXPECT_TRUE(result.converged);
  ASSERT_TRUE(result.scaled);
  EXPECT_LT(std::abs(result.scale - kShort), 3 * result.scale_sigma);
  EXPECT_LT(result.scale_sigma, 0.003);
  EXPECT_LT(survey.farthest(), 0.02);
  for (const ControlResult::Point& p : result.points) {
    EXPECT_EQ(p.marks_left_out, 0U) << p.name;
    EXPECT_LT(p.pixel_rms, 2 * kPixel) << p.name;
    EXPECT_LT((p.off.array() / p.sigma.array()).abs().maxCoeff(), 3) << p.name << ' ' << p.off.transpose();
  }
  EXPECT_THAT(controlWarnings(result), testing::Each(HasSubstr("too short")));  // true of this rig
  EXPECT_THAT(*controlSentence(result), HasSubstr("5 check points are"));
}

TEST(ControlNetwork, ScaleBarsAloneGiveTheScaleAndMoveNothing) {
  ControlSurvey survey;
  for (const double east : {0.3, 3.5}) {
    const auto a = survey.add({0.5, east}, false, false), b = survey.add({3.5, east}, false, false);
    survey.control.bars.push_back({a, b, 3.0, 0.0005, false});
  }
  const ControlResult result = survey.adjusted();
  ASSERT_TRUE(result.scaled);
  EXPECT_NEAR(result.scale, kShort, 0.001);
  EXPECT_LT(std::abs(result.scale - kShort), 3 * result.scale_sigma);
  for (const ControlResult::Bar& bar : result.bars) EXPECT_NEAR(bar.off, 0, 0.001);
  EXPECT_THAT(controlWarnings(result), testing::ElementsAre(HasSubstr("0.7")));
}

TEST(ControlNetwork, OnePointTellsNoScale) {
  ControlSurvey survey;
  (void)survey.add({2, 2}, true, false);
  const ControlResult result = survey.adjusted();
  EXPECT_FALSE(result.scaled);
  EXPECT_EQ(result.scale, 1);
  EXPECT_LT(result.points[0].off.norm(), 0.001);
}

TEST(ControlNetwork, APointSurveyedElsewhereAndAMarkOnAnotherStoneAreLeftOutAndNamed) {
  ControlSurvey survey;
  survey.addUsual();
  survey.control.points[1].place->x() += 0.5;
  for (ControlSighting& mark : survey.sightings)
    if (mark.point == 2) {
      mark.pixel.x() += 60;
      break;
    }
  const ControlResult result = survey.adjusted();
  EXPECT_TRUE(result.points[1].left_out);
  EXPECT_NEAR(result.points[1].off.norm(), 0.5, 0.05);
  EXPECT_EQ(result.points[2].marks_left_out, 1U);
  EXPECT_LT(survey.farthest(), 0.03);
  EXPECT_THAT(controlWarnings(result), testing::ElementsAre(HasSubstr("P1"), HasSubstr("marks of P2")));
}

class ControlFiles : public testing::Test {
 protected:
  void SetUp() override {
    points("name,north,east,depth\nA,1,2,12\nB,4,2,12\n");
    marks("point,image,u,v\nA,1.png,10,20\nB,2.png,30,40\n");
  }
  void points(const std::string& text) { test::writeText(folder_.path() / "points.csv", text); }
  void marks(const std::string& text) { test::writeText(folder_.path() / "marks.csv", text); }
  void bars(const std::string& text) { test::writeText(folder_.path() / "scale_bars.csv", text); }
  std::string why(const std::string& crs = "") {
    return test::refusal([&] { (void)readControlPoints(folder_.path(), crs); });
  }
  static PairList list() {
    return PairList{.pairs = {{0, "left/1.png", "right/1.png"}, {1, "left/2.png", "right/2r.png"}}};
  }
  test::TemporaryFolder folder_;
};

TEST_F(ControlFiles, TablesAreReadWithWhatTheyLeaveOut) {
  points("name,latitude,longitude,height,sigma_m,sigma_depth_m,use\nA,-33.5,151.2,-12,0.02,0.05,check\n");
  marks("point,image,u,v,sigma_px\nA,left/1.png,10,20,\nQ,2r.png,1,2,0.4\nR,2.png,3,4,2\n");
  bars("from,to,length_m\nQ,R,1.5\n");
  ControlPoints control = readControlPoints(folder_.path(), "");
  ASSERT_EQ(control.points.size(), 3U);
  EXPECT_TRUE(control.points[0].check);
  EXPECT_EQ(control.points[0].sigma, Eigen::Vector3d(0.02, 0.02, 0.05));
  EXPECT_FALSE(control.points[1].place.has_value());
  control.placeAbout(*control.firstOnEarth());
  EXPECT_LT((*control.points[0].place - Eigen::Vector3d(0, 0, 12)).norm(), 1e-6);
  const auto seen = sightingsOf(control, list());
  ASSERT_EQ(seen.size(), 3U);
  EXPECT_TRUE(seen[0].left);
  EXPECT_EQ(seen[0].sigma, 1);
  EXPECT_EQ(seen[1].pair, 1U);
  EXPECT_FALSE(seen[1].left);
  EXPECT_EQ(control.bars[0].sigma, 0.001);
}

TEST_F(ControlFiles, EastingsAreOfTheGridThatSomebodyNames) {
  points("name,easting,northing,depth\nA,500000,6250000,12\n");
  EXPECT_THAT(why(), HasSubstr("--control-crs"));
  const auto control = readControlPoints(folder_.path(), "EPSG:32755");
  EXPECT_NEAR(radiansToDegrees(control.points[0].on_earth->longitude), 147, 1e-6);
  EXPECT_THAT(why("EPSG:4326"), HasSubstr("is no projected"));
  points("name,north,east,depth\nA,6250000,500000,12\n");
  EXPECT_THAT(why(), HasSubstr("wide grid"));
}

TEST_F(ControlFiles, WhatIsWrongIsSaidWithItsRow) {
  EXPECT_EQ(why(), "");
  const auto says = [&](const char* what) {
    EXPECT_THAT(why(), HasSubstr(what));
    SetUp();
    std::filesystem::remove(folder_.path() / "scale_bars.csv");
  };
  points("name,north,east,depth\nA,1,2,12\nA,4,2,12\n"), says("row 2: names point 'A' a second time");
  points("name,north,east,depth\nA,1,,12\n"), says("row 1: has nothing in column east");
  points("name,north,east\nA,1,2\n"), says("no column 'depth'");
  points("name,north,east,depth,use\nA,1,2,12,both\n"), says("give control or check");
  points("name,north,east,depth,sigma_m\nA,1,2,12,0\n"), says("not above zero");
  points("name,north,east,depth\nZ,1,2,12\n"), says("no marked point");
  bars("from,to,length_m\nA,Z,1\n"), says("row 1: names point 'Z', which is marked in no image");
  bars("from,to,length_m\nA,A,1\n"), says("joins a point to itself");
  std::filesystem::remove(folder_.path() / "marks.csv"), says("marks.csv: is not there");

  marks("point,image,u,v\nA,1.png,10,20\n");
  const ControlPoints twice = readControlPoints(folder_.path(), "");
  EXPECT_THAT(test::refusal([&] { (void)sightingsOf(twice, list()); }), HasSubstr("give its folder too"));
  marks("point,image,u,v\nA,7.png,10,20\n");
  const ControlPoints other = readControlPoints(folder_.path(), "");
  EXPECT_THAT(test::refusal([&] { (void)sightingsOf(other, list()); }),
              HasSubstr("row 1: marks image '7.png', which is none of the dive's"));
}

}  // namespace
}  // namespace fathom::topside
