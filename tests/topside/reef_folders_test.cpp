// A dive of folders of images alone, as they are when something is wrong with them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogrsf_frmts.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "recon/products/exports/gdal_files.hpp"
#include "recon/products/exports/orthomosaic.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/exports/survey_geopackage.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/reef_quick.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr, testing::Not;

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
