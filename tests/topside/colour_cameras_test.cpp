// Rigs whose colours come from other cameras than the left one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "recon/geometry/ply_reader.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/reef_quick.hpp"
#include "tests/topside/same_colours.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr;

class ColourCameras : public ReefQuick {
 protected:
  // The dive of reef-quick by cameras of other formats.
  static RunPlaces taken(const std::string& name, PixelFormat left, PixelFormat right) {
    sim::Scenario scenario = sim::loadScenario(FATHOM_SOURCE_DIR "/sim/scenarios/reef-quick.toml");
    scenario.scale = 0.25;
    scenario.optics.sensor.left_format = left;
    scenario.optics.sensor.right_format = right;
    const std::filesystem::path mission = out_->path() / name;
    (void)sim::makeMission(scenario, {mission, false, 0, false, {}});
    return {mission, mission / "topside.work", mission / "topside", {}};
  }
  static Mesh modelOf(const RunPlaces& places) {
    (void)runTopside(places, {});
    return readPly(places.out / "mesh.ply");
  }
  static Mesh usual() { return readPly(out_->path() / "topside" / "mesh.ply"); }
};

TEST_F(ColourCameras, BothCamerasColoursAreTexture) {
  const Mesh both = modelOf(taken("both", PixelFormat::kBayerRggb, PixelFormat::kBayerRggb));
  std::printf("colours of both cameras %.1f off those of the left one\n", colourDifference(usual(), both));
  EXPECT_LT(colourDifference(usual(), both), 6);
  EXPECT_GT(hueCorrelation(usual(), both), 0.9);
}

TEST_F(ColourCameras, AGreyLeftCameraLeavesColourToTheRightOne) {
  const Mesh right = modelOf(taken("right", PixelFormat::kMono, PixelFormat::kBayerRggb));
  std::printf("chroma %.2f, %.2f of the left one, correlation %.2f\n", chromaOf(right), chromaOf(usual()),
              hueCorrelation(usual(), right));
  EXPECT_NEAR(chromaOf(right), chromaOf(usual()), 0.3 * chromaOf(usual()));
  EXPECT_GT(hueCorrelation(usual(), right), 0.8);
}

// The right camera's pictures as if a third one's, the pair's as grey as machine vision has them.
TEST_F(ColourCameras, ACameraBesideAGreyPairColoursItsModel) {
  const RunPlaces two = taken("two", PixelFormat::kMono, PixelFormat::kBayerRggb);
  const std::filesystem::path dive = out_->path() / "three";
  for (const char* side : {"left", "right", "colour"}) std::filesystem::create_directories(dive / side);
  std::filesystem::copy(kReefMission / "stereo.calib", dive / "stereo.calib");
  const auto recorded = io::readStereoPoses(out_->path() / "topside" / "stereo_pose_est.data");
  for (std::size_t k = 0; k < recorded.poses.size(); ++k) {
    const std::string number = std::to_string(k) + ".png";
    const auto read = [&](const std::string& name) {
      return cv::imread((two.mission / "img" / name).string(), cv::IMREAD_UNCHANGED);
    };
    const cv::Mat mosaic = read(recorded.poses[k].right_image);
    cv::Mat grey;
    cv::cvtColor(mosaic, grey, cv::COLOR_BayerBG2GRAY);
    cv::imwrite((dive / "left" / number).string(), read(recorded.poses[k].left_image));
    cv::imwrite((dive / "right" / number).string(), grey);
    if (k != 3) cv::imwrite((dive / "colour" / ("shot_" + number)).string(), mosaic);  // one was lost
  }
  RunPlaces places{dive, dive / "work", dive / "topside", {}};
  places.input.poses = out_->path() / "three.data";
  io::writeStereoPoses(places.input.poses, poses_);
  const Mesh grey = modelOf(places);
  EXPECT_LT(chromaOf(grey), 0.1);
  places.input.colour.images = {(dive / "colour" / "*.png").string()};
  EXPECT_THAT(test::refusal([&] { (void)runTopside(places, {}); }), HasSubstr("each camera needs both"));
  places.input.colour.calibs = {kReefMission / "stereo.calib"};
  EXPECT_THAT(test::refusal([&] { (void)runTopside(places, {}); }), HasSubstr("--colour-format bayer"));
  places.input.colour.format = "bayer-rggb";
  const Mesh coloured = modelOf(places);
  std::printf("chroma %.2f, %.2f of the left one, correlation %.2f\n", chromaOf(coloured), chromaOf(usual()),
              hueCorrelation(usual(), coloured));
  EXPECT_NEAR(chromaOf(coloured), chromaOf(usual()), 0.3 * chromaOf(usual()));
  EXPECT_GT(hueCorrelation(usual(), coloured), 0.8);
}

}  // namespace
}  // namespace fathom::topside
