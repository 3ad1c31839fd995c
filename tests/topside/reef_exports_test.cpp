#include <cpl_minixml.h>
#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <ogrsf_frmts.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "realtime/base/input_error.hpp"
#include "recon/products/exports/gdal_files.hpp"
#include "recon/products/exports/orthomosaic.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/exports/sparse_model.hpp"
#include "recon/products/exports/survey_geopackage.hpp"
#include "recon/topside/assemble/assemble.hpp"
#include "tests/support/program_run.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/colmap_files.hpp"
#include "tests/topside/reef_quick.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr, testing::Not;

// What the run of the reef left, taken up again.
SparseModel taken(const RunPlaces& places, const TopsideConfig& config) {
  StageStore store(places.work, StageStore::Access::kShared);
  RunProgress progress(1.0);
  Dive dive(openMission(places.mission, places.input), config, store, progress, {Stage::kLevel, {}});
  return sparseModelOf(dive);
}

TEST_F(ReefQuick, ColmapsModelOfARunHoldsMeasuredPixelsAPixelFromWhereItsPointsProject) {
  const SparseModel model = taken(run(), {});
  writeColmapModel(out_->path() / "sparse", model, ColmapFormat::kBinary);
  const test::ColmapFiles read(out_->path() / "sparse");
  EXPECT_EQ(read.images.size(), 2 * done_.pairs);
  double sum = 0, pixels = 0, joined = 0, coloured = 0;
  for (const auto& [id, point] : read.points) {
    const double error = read.errorOf(point), views = static_cast<double>(point.track.size());
    EXPECT_NEAR(point.error, error, 1e-3);
    sum += error * views;
    pixels += views;
    joined += views > 2 ? 1 : 0;
    coloured += point.colour != std::array<std::uint8_t, 3>{128, 128, 128} ? 1 : 0;
  }
  const double points = static_cast<double>(read.points.size());
  std::printf("%.0f points, %.0f pixels, %.3f px, %.1f %% of the points in several pairs\n", points, pixels,
              sum / pixels, 100 * joined / points);
  EXPECT_LT(sum / pixels, 0.21);  // twice what was measured
  EXPECT_GT(joined, 0.2 * points);
  EXPECT_GT(coloured, 0.99 * points);
  for (const auto& [id, image] : read.images)
    EXPECT_TRUE(std::filesystem::exists(kReefMission / "img" / image.name)) << image.name;
}

TEST_F(ReefQuick, OtherSettingsThanTheRunsAreRefusedAndNothingIsMade) {
  TopsideConfig config;
  config.slam_features = 300;
  EXPECT_THROW((void)taken(run(), config), InputError);
}

DatasetPtr opened(const std::filesystem::path& path) {
  return DatasetPtr(static_cast<GDALDataset*>(GDALOpenEx(path.c_str(), 0, nullptr, nullptr, nullptr)));
}

TEST_F(ReefQuick, ResultsLeadToTheirMissionsCameras) {
  const std::filesystem::path scene = out_->path() / "scene";
  const test::Outcome outcome =
      test::runProgram("fathom-topside export-model " + run().out.string() + " --work " +
                       run().work.string() + " --nerfstudio " + scene.string());
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto frames = nlohmann::json::parse(test::readText(scene / "transforms.json")).at("frames");
  ASSERT_EQ(frames.size(), 2 * done_.used);
  EXPECT_TRUE(std::filesystem::exists(scene / frames[0].at("file_path").get<std::string>()));
}

TEST_F(ReefQuick, AProjectOfQgisNamesEveryLayerInItsPlace) {
  const std::filesystem::path folder = out_->path() / "gis", results = run().out;
  writeQgisProject(folder, results, "EPSG:32631", 0);
  writeQgisProject(folder, results, "EPSG:32631", 0);  // over its own
  const GdalUse gdal;
  std::unique_ptr<CPLXMLNode, decltype(&CPLDestroyXMLNode)> xml(
      CPLParseXMLFile((folder / "survey.qgs").c_str()), CPLDestroyXMLNode);
  ASSERT_TRUE(xml);
  std::size_t rasters = 0, vectors = 0;
  const CPLXMLNode* all = CPLGetXMLNode(xml.get(), "=qgis.projectlayers");
  ASSERT_NE(all, nullptr);
  for (const CPLXMLNode* layer = all->psChild; layer != nullptr; layer = layer->psNext) {
    const std::string source = CPLGetXMLValue(layer, "datasource", "");
    const std::string file = source.substr(0, source.find('|'));
    EXPECT_TRUE(opened(folder / file)) << source;
    ++(std::string(CPLGetXMLValue(layer, "type", "")) == "raster" ? rasters : vectors);
  }
  EXPECT_EQ(rasters, readResultJson(results / "scene.json").at("layers").size());
  EXPECT_GE(rasters, 9U);
  EXPECT_EQ(vectors, 3U);
  test::writeText(folder / "mine.txt", "x");
  EXPECT_THAT(test::refusal([&] { writeQgisProject(folder, results, "EPSG:32631", 0); }),
              testing::HasSubstr("mine.txt"));
}

TEST_F(ReefQuick, AGeopackageHoldsFootprintsTrackAndContoursInUtm) {
  const std::filesystem::path path = out_->path() / "reef.gpkg", results = run().out;
  const std::string crs = utmOf(*originOf(results));
  const GeopackageCounts counts = writeSurveyGeopackage(path, results, crs, 0);
  EXPECT_EQ(counts.footprints, done_.pairs);
  const GdalUse gdal;
  const DatasetPtr file = opened(path);
  ASSERT_TRUE(file);
  ASSERT_EQ(file->GetLayerCount(), 3);
  OGRLayer& footprints = *file->GetLayerByName("footprints");
  EXPECT_EQ(footprints.GetSpatialRef()->GetAuthorityCode(nullptr), crs.substr(5));
  EXPECT_EQ(static_cast<std::size_t>(footprints.GetFeatureCount()), done_.pairs);
  // The track leads over the footprints, all of which look at about the square metre below the vehicle.
  const auto track = std::unique_ptr<OGRFeature>(file->GetLayerByName("track")->GetNextFeature());
  for (const auto& pair : footprints) {
    const OGRPolygon& polygon = *pair->GetGeometryRef()->toPolygon();
    EXPECT_TRUE(polygon.Intersects(track->GetGeometryRef()));
    EXPECT_GT(polygon.get_Area(), 0.3);
    EXPECT_LT(polygon.get_Area(), 10);
    EXPECT_TRUE(std::filesystem::exists(kReefMission / "img" / pair->GetFieldAsString("left")));
    EXPECT_NEAR(pair->GetFieldAsDouble("altitude_m"), 2, 1);
  }
  OGREnvelope all;
  ASSERT_EQ(footprints.GetExtent(&all), OGRERR_NONE);
  OGRLayer& contours = *file->GetLayerByName("contours");
  EXPECT_EQ(static_cast<std::size_t>(contours.GetFeatureCount()), counts.contours);
  ASSERT_GT(counts.contours, 0U);
  std::set<double> heights;
  for (const auto& line : contours) {
    OGREnvelope box;
    line->GetGeometryRef()->getEnvelope(&box);
    EXPECT_TRUE(all.Intersects(box));
    heights.insert(line->GetFieldAsDouble("height_m"));
  }
  EXPECT_LE(heights.size(), 21U);
  EXPECT_GE(heights.size(), 8U);
  EXPECT_LT(*heights.rbegin(), -1);  // below the water's surface
}

TEST_F(ReefQuick, TheOrthomosaicInAnotherSystemShowsTheSameGroundThere) {
  const std::filesystem::path results = run().out, path = out_->path() / "ortho.tif";
  const GdalUse gdal;
  const DatasetPtr layer = opened(results / "layers" / "orthomosaic.tif");
  ASSERT_TRUE(layer);
  for (const bool lossless : {true, false}) {
    writeOrthomosaic(path, results, {utmOf(*originOf(results)), 0.02, lossless});
    const DatasetPtr ortho = opened(path);
    ASSERT_TRUE(ortho);
    EXPECT_STREQ(ortho->GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE"), "COG");
    // Both say what their colours are.
    const char* profile = ortho->GetMetadataItem("SOURCE_ICC_PROFILE", "COLOR_PROFILE");
    ASSERT_NE(profile, nullptr);
    EXPECT_STREQ(layer->GetMetadataItem("SOURCE_ICC_PROFILE", "COLOR_PROFILE"), profile);
    std::array<double, 6> grid{}, from{};
    ortho->GetGeoTransform(grid.data());
    layer->GetGeoTransform(from.data());
    EXPECT_DOUBLE_EQ(grid[1], 0.02);
    OGRCoordinateTransformation* to_layer =
        OGRCreateCoordinateTransformation(ortho->GetSpatialRef(), layer->GetSpatialRef());
    ASSERT_NE(to_layer, nullptr);
    double difference = 0, count = 0;
    for (int row = 0; row < ortho->GetRasterYSize(); row += 4)
      for (int column = 0; column < ortho->GetRasterXSize(); column += 4) {
        std::array<std::uint8_t, 4> there{}, here{};
        double x = grid[0] + grid[1] * (column + 0.5), y = grid[3] + grid[5] * (row + 0.5);
        to_layer->Transform(1, &x, &y);
        const int u = static_cast<int>(std::floor((x - from[0]) / from[1])),
                  v = static_cast<int>(std::floor((y - from[3]) / from[5]));
        if (u < 0 || v < 0 || u >= layer->GetRasterXSize() || v >= layer->GetRasterYSize()) continue;
        // The fourth: alpha, or the mask instead of it.
        const auto read = [](GDALDataset& file, int i, int j, std::array<std::uint8_t, 4>& rgba) {
          return file.RasterIO(GF_Read, i, j, 1, 1, rgba.data(), 1, 1, GDT_Byte, 3, nullptr, 1, 1, 1) ==
                     CE_None &&
                 file.GetRasterBand(1)->GetMaskBand()->RasterIO(GF_Read, i, j, 1, 1, &rgba[3], 1, 1, GDT_Byte,
                                                                0, 0) == CE_None;
        };
        ASSERT_TRUE(read(*ortho, column, row, here) && read(*layer, u, v, there));
        if (here[3] < 255 || there[3] < 255) continue;
        for (std::size_t c = 0; c < 3; ++c) difference += std::abs(here[c] - there[c]);
        count += 3;
      }
    OGRCoordinateTransformation::DestroyCT(to_layer);
    ASSERT_GT(count, 3000);
    std::printf("%s: colours %.1f of 255 apart\n", lossless ? "lossless" : "JPEG", difference / count);
    EXPECT_LT(difference / count, lossless ? 5.6 : 8.6);  // twice what was measured
  }
  writeOrthomosaic(path, results, {utmOf(*originOf(results)), 0, false});
  std::array<double, 6> finest{};
  opened(path)->GetGeoTransform(finest.data());
  const double texel = readResultJson(results / "scene.json")["levels"][0]["texel_m"].get<double>();
  EXPECT_NEAR(finest[1], texel, 0.02 * texel);
  for (const auto& entry : std::filesystem::directory_iterator(out_->path()))
    EXPECT_EQ(entry.path().filename().string().find(".own"), std::string::npos);
  EXPECT_THROW(writeOrthomosaic(path, results, {"EPSG:1", 0, false}), InputError);
  EXPECT_THROW(writeOrthomosaic(path, out_->path(), {"EPSG:32755", 0, false}), InputError);
}

// A dive of folders of images alone, as they are when something is wrong with them.

// Numbered pairs of the dive, as --pairs wants them.
std::filesystem::path listOf(const std::filesystem::path& dive, const std::vector<int>& numbers) {
  std::string text = "left,right\n";
  for (const int k : numbers)
    text += "left/" + std::to_string(k) + ".png,right/" + std::to_string(k) + ".png\n";
  const std::filesystem::path path = dive / ("list" + std::to_string(numbers.size()) + ".csv");
  test::writeText(path, text);
  return path;
}

nlohmann::json reportOf(const RunPlaces& places) {
  return nlohmann::json::parse(test::readText(places.out / "report.json"));
}

TEST_F(ReefQuick, PartsThatNothingJoinsAreTwoTracksInMetresOfTheirOwn) {
  RunPlaces places = placesOf("parts");
  places.input.files.pairs = listOf(dive(), {0, 1, 2, 3, 4, 5, 16, 17, 18, 19, 20});
  (void)runTopside(places, {});
  const auto parts = reportOf(places).at("localisation").at("parts");
  ASSERT_EQ(parts.size(), 2u) << parts;
  const auto track = nlohmann::json::parse(test::readText(places.out / "track.json"));
  EXPECT_EQ(std::count(track["north"].begin(), track["north"].end(), nullptr), 1);
  EXPECT_TRUE(track["north"].at(6).is_null());
  EXPECT_FALSE(track["timed"].get<bool>());
  EXPECT_FALSE(originOf(places.out).has_value());

  const GdalUse gdal;
  const std::filesystem::path vectors = out_->path() / "parts.gpkg", picture = out_->path() / "parts.tif";
  (void)writeSurveyGeopackage(vectors, places.out, "", 0);
  const DatasetPtr file(GDALDataset::Open(vectors.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY));
  ASSERT_TRUE(file);
  EXPECT_EQ(file->GetLayerByName("track")->GetFeatureCount(), 2);
  const OGRSpatialReference* srs = file->GetLayerByName("track")->GetSpatialRef();
  EXPECT_TRUE(srs == nullptr || srs->IsLocal());
  writeOrthomosaic(picture, places.out, {"", 0, false});
  for (const std::filesystem::path& raster : {picture, places.out / "layers" / "elevation.tif"}) {
    const DatasetPtr set(GDALDataset::Open(raster.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
    ASSERT_TRUE(set) << raster;
    EXPECT_EQ(std::string(set->GetProjectionRef()), "") << raster;
  }
  const std::string page = test::readText(places.out / "report.html");
  for (const char* of_navigation : {"bottom-track", "dead reckoning", "outside the navigation"})
    EXPECT_THAT(page, Not(HasSubstr(of_navigation)));
  EXPECT_THAT(page, HasSubstr("triangles a m²"));
}

TEST_F(ReefQuick, DamagedImagesAreCountedAsUnreadableAndNamed) {
  RunPlaces places = placesOf("damaged");
  places.input.files.pairs = listOf(dive(), {0, 1, 2, 3, 4, 5, 6, 7});
  const std::string whole = test::readText(dive() / "left/7.png");
  test::writeText(dive() / "left/7.png", whole.substr(0, whole.size() / 3));
  (void)runTopside(places, {});
  test::writeText(dive() / "left/7.png", whole);
  const auto pairs = reportOf(places).at("pairs");
  EXPECT_EQ(pairs["unreadable"], 1);
  EXPECT_EQ(pairs["without_pose"], 0);
  ASSERT_EQ(pairs["unreadable_images"].size(), 1u);
  EXPECT_THAT(pairs["unreadable_images"][0].get<std::string>(), HasSubstr("left/7.png"));
}

TEST_F(ReefQuick, ARunThatIsOnlyCheckedSaysWhatItWouldRefuseAndWritesNothing) {
  RunPlaces places = placesOf("checked");
  places.input.files.pairs = listOf(dive(), {0, 1, 2, 3, 4, 5, 6, 7, 8});
  const std::string whole = test::readText(dive() / "right/4.png");
  test::writeText(dive() / "right/4.png", whole.substr(0, whole.size() / 3));
  const RunCheck found = checkRun(places, {});
  test::writeText(dive() / "right/4.png", whole);
  EXPECT_EQ(found.pairs, 9u);
  EXPECT_EQ(found.looked, 9u);
  ASSERT_EQ(found.unreadable.size(), 1u);
  EXPECT_THAT(found.unreadable[0], HasSubstr("right/4.png"));
  EXPECT_GT(found.seconds, 0);
  for (const std::filesystem::path& path : {places.out, places.work})
    EXPECT_FALSE(std::filesystem::exists(path)) << path;
  test::writeText(places.out / "thesis.txt", "years of work");
  EXPECT_THAT(test::refusal([&] { (void)checkRun(places, {}); }), HasSubstr("thesis.txt"));
  places = RunPlaces{kReefMission, out_->path() / "n.work", out_->path() / "new" / "n", {}};
  EXPECT_EQ(checkRun(places, {}).unreadable.size(), 0u);
  EXPECT_FALSE(std::filesystem::exists(out_->path() / "new"));
}

TEST_F(ReefQuick, ACalibrationOfImagesOfAnotherSizeIsSaid) {
  RunPlaces places = placesOf("sizes");
  places.input.files.pairs = listOf(dive(), {0, 1, 2});
  StereoRig rig = readStereoCalib(kReefMission / "stereo.calib");
  for (Camera* camera : {&rig.left, &rig.right}) camera->width += 8;
  places.input.calib = dive() / "wide.calib";
  writeStereoCalib(places.input.calib, rig);
  const std::string why = test::refusal([&] { (void)runTopside(places, {}); });
  EXPECT_THAT(why, HasSubstr("no usable stereo pair of 3: 3 unreadable, 0 that show too little"));
  EXPECT_THAT(why, HasSubstr("where the calibration says"));
}

}  // namespace
}  // namespace fathom::topside
