#include <cpl_error.h>
#include <gdal_priv.h>
#include <gmock/gmock.h>

#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <random>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/products/tiles/check/tile_check.hpp"
#include "sim/mission/mission_maker.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/reef_quick.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr;

// Rigs whose colours come from other cameras than the left one.

class ColourCameras : public ReefQuick {
 protected:
  static sim::Scenario reefQuick() {
    sim::Scenario scenario = sim::loadScenario(FATHOM_SOURCE_DIR "/sim/scenarios/reef-quick.toml");
    scenario.scale = 0.25;
    return scenario;
  }
  // The dive of reef-quick by cameras of other formats.
  static RunPlaces taken(const std::string& name, PixelFormat left, PixelFormat right) {
    sim::Scenario scenario = reefQuick();
    scenario.optics.sensor.left_format = left;
    scenario.optics.sensor.right_format = right;
    return made(name, scenario);
  }
  static RunPlaces made(const std::string& name, const sim::Scenario& scenario) {
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

// Daylight shows the ground in those pictures, dim and green.
TEST_F(ColourCameras, PicturesThatTheStrobesLeftDarkLeaveNoBlot) {
  sim::Scenario scenario = reefQuick();
  scenario.optics.daylight.irradiance = 0.15;
  const Mesh all_lit = modelOf(made("lit", scenario));
  scenario.optics.dark_probability = 0.4;
  const Mesh some_dark = modelOf(made("dark", scenario));
  std::printf("colours %.1f off those of pictures that were all lit\n", colourDifference(all_lit, some_dark));
  EXPECT_LT(colourDifference(all_lit, some_dark), 12);
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

// A dive whose images show the vehicle's own frame, hidden by masks.

// A bar along one side and a foot in a corner; 0 hides.
cv::Mat frameOf(const cv::Size& size, CameraSide side) {
  cv::Mat shown(size, CV_8U, cv::Scalar(255));
  const int shift = side == CameraSide::kLeft ? 0 : size.width / 20;
  cv::rectangle(shown, {shift, 0}, {shift + size.width / 7, size.height}, 0, cv::FILLED);
  cv::circle(shown, {size.width, size.height}, size.height / 4 + shift, 0, cv::FILLED);
  return shown;
}

// The frame is red and speckled, and stands still in all images of a camera.
void drawFrame(cv::Mat& image, const cv::Mat& shown) {
  std::mt19937 random(3);
  std::uniform_int_distribution<int> speckle(0, 3);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const int grain = speckle(random);
      if (shown.at<std::uint8_t>(y, x) != 0) continue;
      const bool red = x % 2 == 0 && y % 2 == 0;
      image.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>((red ? 2000 : 200) / (1 + grain));
    }
}

class FramedDive : public ReefQuick {
 protected:
  static std::filesystem::path framed() { return out_->path() / "framed"; }
  static void SetUpTestSuite() {
    ReefQuick::SetUpTestSuite();
    std::filesystem::create_directories(framed() / "img");
    for (const char* name : {"mission.toml", "sensors.lcmlog", "stereo.calib"})
      std::filesystem::create_symlink(kReefMission / name, framed() / name);
    for (const auto& entry : std::filesystem::directory_iterator(kReefMission / "img")) {
      const std::string name = entry.path().filename().string();
      const auto parsed = io::parseImageFileName(name);
      cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
      drawFrame(image, frameOf(image.size(), parsed->side));
      cv::imwrite((framed() / "img" / name).string(), image);
    }
  }
  static RunPlaces placesOf(const std::string& name) {
    return {framed(), out_->path() / (name + ".work"), out_->path() / name, {}};
  }
  static std::filesystem::path maskFile(const std::string& name, CameraSide side) {
    const std::filesystem::path file = out_->path() / name;
    std::filesystem::create_directories(file.parent_path());
    const StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
    cv::imwrite(file.string(), frameOf({rig.left.width, rig.left.height}, side));
    return file;
  }

  struct Model {
    Summary summary;
    double surface = 0;  // 95 % of its vertices are nearer to the true seafloor [m]
    double colour = 0;   // rms difference from the dive without a frame [grey levels]
  };
  static Model modelOf(const RunPlaces& places) {
    Model out{.summary = runTopside(places, {})};
    const Eigen::Vector3f shift =
        shiftToTruth(kReefMission, places.out, out.summary.pairs, 0.3).cast<float>();
    const Mesh seafloor = readPly(kReefMission / "truth" / "terrain.ply");
    const test::SurfaceDistance to_seafloor(seafloor, 0.25F);
    const Mesh clean = readPly(out_->path() / "topside" / "mesh.ply"),
               mesh = readPly(places.out / "mesh.ply");
    std::vector<float> distances;
    for (const Eigen::Vector3f& v : mesh.vertices) distances.push_back(to_seafloor(v + shift));
    std::sort(distances.begin(), distances.end());
    out.surface = static_cast<double>(distances[distances.size() * 95 / 100]);
    out.colour = colourDifference(clean, mesh);
    return out;
  }
};

TEST_F(FramedDive, HiddenPartsOfTheVehicleLeaveNoTrace) {
  RunPlaces seen = placesOf("seen"), hidden = placesOf("hidden");
  hidden.input.masks = maskFile("masks/left.png", CameraSide::kLeft).parent_path();
  (void)maskFile("masks/right.png", CameraSide::kRight);
  const Model clean = modelOf(run()), with = modelOf(seen), without = modelOf(hidden);
  for (const auto& [name, model] : {std::pair("seen", &with), std::pair("hidden", &without)})
    std::printf("%s: colours %.1f off, surface %.1f mm (%.1f), area %.1f m2 (%.1f)\n", name, model->colour,
                1e3 * model->surface, 1e3 * clean.surface, model->summary.area, done_.area);
  EXPECT_EQ(without.summary.used, done_.used);
  EXPECT_LT(without.colour, 0.6 * with.colour);
  // 1.15 of what the clean dive had without its scale (31 mm), which is found by whole images alone.
  EXPECT_LT(without.surface, 0.036);
  EXPECT_GT(without.summary.area, with.summary.area);
}

// By image, named as other programs do, on top of the same for all images of a camera.
TEST_F(FramedDive, MasksOfSingleImagesAreFoundByTheirNames) {
  const StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
  const std::filesystem::path folder = maskFile("single/right.png", CameraSide::kRight).parent_path();
  for (const char* name : {"single/left/0.png.png", "single/left/1_mask.png", "single/left/2.png"})
    (void)maskFile(name, CameraSide::kLeft);
  (void)maskFile("single/right/1.png", CameraSide::kLeft);
  const ImageMasks masks(folder, {rig.left, rig.right});
  const cv::Mat shown = frameOf({rig.left.width, rig.left.height}, CameraSide::kLeft),
                right = frameOf({rig.left.width, rig.left.height}, CameraSide::kRight);
  for (const char* image : {"left/0.png", "left/1.tif", "left/2.jpg"}) {
    const auto mask = masks.of(image, 0);
    ASSERT_TRUE(mask) << image;
    for (int y = 0; y < shown.rows; y += 5)
      for (int x = 0; x < shown.cols; x += 5)
        EXPECT_EQ(mask->hides({x, y}), shown.at<std::uint8_t>(y, x) == 0) << image;
  }
  EXPECT_FALSE(masks.of("left/3.png", 0));
  const auto both = masks.of("right/1.png", 1);
  for (int x = 0; x < shown.cols; ++x)
    EXPECT_EQ(both->hides({x, 9}), shown.at<std::uint8_t>(9, x) == 0 || right.at<std::uint8_t>(9, x) == 0);
}

TEST_F(FramedDive, MasksThatCannotBeMeantAreRefusedByName) {
  const auto why = [&](const std::filesystem::path& masks) {
    RunPlaces places = placesOf("refused");
    places.input.masks = masks;
    return test::refusal([&] { (void)runTopside(places, {}); });
  };
  const StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
  const std::filesystem::path out = out_->path();
  std::filesystem::create_directories(out / "none");
  cv::imwrite((out / "black.png").string(), cv::Mat(rig.left.height, rig.left.width, CV_8U, cv::Scalar(0)));
  cv::imwrite((out / "large.png").string(), cv::Mat(rig.left.height, 900, CV_8U, cv::Scalar(255)));
  EXPECT_THAT(why(out / "absent.png"), HasSubstr("is not there"));
  EXPECT_THAT(why(out / "none"), HasSubstr("NAME_mask.png for the image NAME"));
  EXPECT_THAT(why(out / "black.png"), HasSubstr("hides the whole image"));
  EXPECT_THAT(why(out / "large.png"), HasSubstr("a mask has the size of its image"));
  (void)maskFile("others/IMG_0001_mask.png", CameraSide::kLeft);
  EXPECT_THAT(why(out / "others"), HasSubstr("none of its 1 masks is of an image of the dive"));
}

// A model that keeps to polygons somebody drew.

class RegionOfADive : public ReefQuick {
 protected:
  static std::filesystem::path file(const std::string& name, const std::string& text) {
    const std::filesystem::path path = out_->path() / name;
    test::writeText(path, text);
    return path;
  }
  // A ring of (north, east) [m] in degrees.
  static std::string ring(const std::vector<std::array<double, 2>>& corners) {
    const LocalTransverseMercator projection(io::readMissionConfig(kReefMission).origin);
    std::string text = "[";
    for (std::size_t k = 0; k <= corners.size(); ++k) {
      const auto& [north, east] = corners[k % corners.size()];
      const Geodetic at = projection.toGeodetic({north, east});
      text += formatted("%s[%.10f,%.10f]", k > 0 ? "," : "", radiansToDegrees(at.longitude),
                        radiansToDegrees(at.latitude));
    }
    return text + "]";
  }
  static std::string polygon(const std::string& rings) {
    return R"({"type":"FeatureCollection","features":[{"type":"Feature","properties":{},"geometry":{"type":"Polygon","coordinates":[)" +
           rings + "]}}]}";
  }
  static std::string why(const std::filesystem::path& region) {
    RunPlaces places = run();
    places.work = out_->path() / "refused.work";
    places.out = out_->path() / "refused";
    places.input.region = region;
    return test::refusal([&] { (void)runTopside(places, {}); });
  }
};

TEST_F(RegionOfADive, HoldsMeshLayersAndStatistics) {
  const Mesh whole = readPly(out_->path() / "topside" / "mesh.ply");
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  for (const auto& v : whole.vertices) middle += v / static_cast<float>(whole.vertices.size());
  const double n = static_cast<double>(middle.x()), e = static_cast<double>(middle.y());
  // A slanting quadrangle with a hole.
  const std::vector<std::array<double, 2>> outer{
      {n - 0.8, e - 0.5}, {n + 0.9, e - 0.7}, {n + 0.7, e + 0.6}, {n - 0.6, e + 0.8}},
      hole{{n - 0.2, e - 0.2}, {n + 0.2, e - 0.2}, {n + 0.2, e + 0.2}, {n - 0.2, e + 0.2}};
  RunPlaces places = run();
  places.work = out_->path() / "region.work";
  places.out = out_->path() / "region";
  places.input.region = file("region.geojson", polygon(ring(outer) + "," + ring(hole)));
  const Summary kept = runTopside(places, {});
  const Region region(places.input.region, io::readMissionConfig(kReefMission).origin);
  std::printf("%.2f m2 of surface in a region of %.2f m2, of %.2f\n", kept.area, region.area(), done_.area);
  EXPECT_NEAR(kept.area, region.area(), 0.1 * region.area());  // the seafloor is rough
  const Mesh mesh = readPly(places.out / "mesh.ply");
  // Single vertices were moved by the lattice and by what simplification did to the edge.
  std::size_t outside = 0;
  for (const auto& v : mesh.vertices) {
    const double north = static_cast<double>(v.x()), east = static_cast<double>(v.y());
    bool near = false;
    for (const double dn : {-0.04, 0.0, 0.04})
      for (const double de : {-0.04, 0.0, 0.04}) near |= region.contains(north + dn, east + de);
    outside += near ? 0 : 1;
  }
  EXPECT_EQ(outside, 0u) << mesh.vertices.size();
  EXPECT_EQ(kept.used, done_.used);
  const TileCheck check = checkTiles(places.out);
  for (const std::string& line : check.faults) ADD_FAILURE() << line;
  // The mosaic and all that is counted in it.
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  GDALAllRegister();
  const GDALDatasetUniquePtr elevation(
      GDALDataset::Open((places.out / "layers" / "elevation.tif").c_str(), GDAL_OF_RASTER));
  ASSERT_TRUE(elevation);
  double low = 0, high = 0, mean = 0, deviation = 0;
  EXPECT_EQ(
      elevation->GetRasterBand(1)->ComputeStatistics(0, &low, &high, &mean, &deviation, nullptr, nullptr),
      CE_None);
  const double share =
      std::stod(elevation->GetRasterBand(1)->GetMetadataItem("STATISTICS_VALID_PERCENT")) / 100;
  std::array<double, 6> frame{};
  elevation->GetGeoTransform(frame.data());
  const double covered =
      share * elevation->GetRasterXSize() * elevation->GetRasterYSize() * std::abs(frame[1] * frame[5]);
  EXPECT_NEAR(covered, region.area(), 0.1 * region.area());
}

TEST_F(RegionOfADive, ThatCannotBeMeantIsRefused) {
  EXPECT_THAT(why(out_->path() / "absent.geojson"), HasSubstr("cannot be read"));
  EXPECT_THAT(why(file("half.geojson", R"({"type":"FeatureColl)")), HasSubstr("cannot be read"));
  EXPECT_THAT(why(file("line.geojson", R"({"type":"LineString","coordinates":[[1,2],[3,4]]})")),
              HasSubstr("has no polygon"));
  EXPECT_THAT(why(file("far.geojson", polygon(ring({{900, 0}, {901, 0}, {901, 1}, {900, 1}})))),
              HasSubstr("has nothing of what was seen"));
  EXPECT_THAT(why(file("poles.geojson", polygon("[[0,91],[1,20],[40,80],[0,91]]"))),
              HasSubstr("is no place on Earth"));
}

// Without a place on Earth coordinates are the dive's own, as the viewer writes them.
TEST_F(RegionOfADive, OfADiveWithoutNavigationIsInItsOwnMetres) {
  RunPlaces places = placesOf("own");
  places.input.region =
      file("own.geojson", polygon("[[-0.5,-0.5],[0.5,-0.5],[0.5,0.5],[-0.5,0.5],[-0.5,-0.5]]"));
  const Summary kept = runTopside(places, {});
  std::printf("%.2f m2 of surface in 1 m2\n", kept.area);
  EXPECT_NEAR(kept.area, 1.0, 0.1);
}

}  // namespace
}  // namespace fathom::topside
