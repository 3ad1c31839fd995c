#include "recon/products/rasters/layer_set.hpp"
#include "realtime/base/units.hpp"

#include <fnmatch.h>
#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>
#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "recon/products/rasters/cog_writer.hpp"
#include "recon/products/rasters/patch_mosaic.hpp"
#include "recon/products/rasters/terrain.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::topside {
namespace {

const Geodetic kGridOrigin{-33.123456 * kRadiansPerDegree, 151.987654 * kRadiansPerDegree};

struct Close {
  void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
};
using Dataset = std::unique_ptr<GDALDataset, Close>;
Dataset open(const std::filesystem::path& path) {
  GDALAllRegister();
  return Dataset(static_cast<GDALDataset*>(GDALOpen(path.c_str(), GA_ReadOnly)));
}

class LayerSet : public ::testing::Test {
 protected:
  LayerSet() { inputs_.origin = kGridOrigin; }

  void tiles(const TileRange& range, double step, const test::Depth& depth) {
    for (std::int32_t x = range.x0; x < range.x1; ++x)
      for (std::int32_t y = range.y0; y < range.y1; ++y) inputs_.tiles.push_back({0, x, y});
    inputs_.patch = [this, step, depth](const TileId& tile) {
      return packLayerPatch(
          makeLayerPatch(test::fieldTile(tile, inputs_.grid, step, depth), inputs_.grid, config_.cells));
    };
  }
  // Value of a one-band layer at a place.
  static float at(GDALDataset& file, double north, double east) {
    double t[6];
    file.GetGeoTransform(t);
    float value = 0;
    const int x = static_cast<int>(std::floor((east - t[0]) / t[1]));
    const int y = static_cast<int>(std::floor((north - t[3]) / t[5]));
    EXPECT_EQ(file.GetRasterBand(1)->RasterIO(GF_Read, x, y, 1, 1, &value, 1, 1, GDT_Float32, 0, 0, nullptr),
              CE_None);
    return value;
  }

  const fathom::test::TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path();
  LayerInputs inputs_;
  LayerConfig config_;
};

// A plane that falls by 20 degrees towards 125 degrees.
double fallingPlane(double n, double e) {
  return 15 + std::tan(20 * kRadiansPerDegree) *
                  (n * std::cos(125 * kRadiansPerDegree) + e * std::sin(125 * kRadiansPerDegree));
}

TEST_F(LayerSet, ATiltedPlaneHasItsSlopeAndAspectAndHeights) {
  config_.cells.mosaic = 0.02;
  tiles({-2, 1, 1, 4}, 0.132, fallingPlane);
  const auto layers = writeLayers(folder_, inputs_, config_);
  std::vector<std::string> names;
  for (const LayerInfo& layer : layers) names.push_back(layer.name);
  EXPECT_EQ(names, (std::vector<std::string>{"elevation", "orthomosaic", "slope", "aspect", "rugosity",
                                             "views", "uncertainty"}));
  const auto elevation = open(folder_ / "layers/elevation.tif"), slope = open(folder_ / "layers/slope.tif"),
             aspect = open(folder_ / "layers/aspect.tif"), rugged = open(folder_ / "layers/rugosity.tif");
  ASSERT_TRUE(elevation && slope && aspect && rugged);
  for (double north = -3.9; north < 1.9; north += 0.37) {
    for (double east = 2.4; east < 8.2; east += 0.41) {
      const double z = static_cast<double>(at(*elevation, north, east));
      EXPECT_NEAR(z, -fallingPlane(north, east), 0.033 * std::tan(20 * kRadiansPerDegree));
      EXPECT_NEAR(at(*slope, north, east), 20, 0.25);
      EXPECT_NEAR(at(*aspect, north, east), 125, 0.8);
      EXPECT_NEAR(at(*rugged, north, east), 1, 0.001);
    }
  }
  EXPECT_TRUE(std::isnan(elevation->GetRasterBand(1)->GetNoDataValue()));
  EXPECT_STREQ(elevation->GetRasterBand(1)->GetUnitType(), "m");
}

TEST_F(LayerSet, GdalPlacesAKnownPointWithinAMillimetre) {
  tiles({100, 200, 102, 201}, 0.132, fallingPlane);  // some 200 m and 400 m off the origin
  config_.picture_pixels = 0;
  const auto layers = writeLayers(folder_, inputs_, config_);
  ASSERT_FALSE(layers.empty());
  const auto file = open(folder_ / "layers/elevation.tif");
  ASSERT_TRUE(file);
  double t[6];
  file->GetGeoTransform(t);
  OGRSpatialReference world;
  world.SetWellKnownGeogCS("WGS84");
  world.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  ASSERT_NE(file->GetSpatialRef(), nullptr);
  OGRSpatialReference local(*file->GetSpatialRef());
  local.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const std::unique_ptr<OGRCoordinateTransformation> transformation(
      OGRCreateCoordinateTransformation(&local, &world));
  ASSERT_TRUE(transformation);
  const LocalTransverseMercator truth(kGridOrigin);
  for (const int pixel : {0, 63}) {
    double east = t[0] + (pixel + 0.5) * t[1], north = t[3] + (pixel + 0.5) * t[5];
    const Geodetic expected = truth.toGeodetic({north, east});
    double x = east, y = north;
    ASSERT_TRUE(transformation->Transform(1, &x, &y));
    constexpr double kMetresPerDegree = 111'000;
    EXPECT_NEAR(x * kMetresPerDegree, expected.longitude / kRadiansPerDegree * kMetresPerDegree, 0.001);
    EXPECT_NEAR(y * kMetresPerDegree, expected.latitude / kRadiansPerDegree * kMetresPerDegree, 0.001);
  }
  EXPECT_NEAR(t[0], 200 * 2.112, 0.001);
  EXPECT_NEAR(t[3], 102 * 2.112, 0.001);
}

TEST_F(LayerSet, FilesAreCloudOptimisedWithOverviewsAndTheMosaicKeepsItsColours) {
  config_.mosaic_quality = 0;
  tiles({0, 0, 3, 3}, 0.264, fallingPlane);
  const auto layers = writeLayers(folder_, inputs_, config_);
  for (const LayerInfo& layer : layers) {
    const auto file = open(folder_ / layer.file);
    ASSERT_TRUE(file) << layer.file;
    const char* layout = file->GetMetadataItem("LAYOUT", "IMAGE_STRUCTURE");
    ASSERT_NE(layout, nullptr) << layer.file;
    EXPECT_STREQ(layout, "COG");
    EXPECT_TRUE(std::filesystem::exists(folder_ / layer.picture)) << layer.picture;
    if (layer.name != "orthomosaic") {
      EXPECT_LT(layer.min, layer.max) << layer.name;
    }
  }
  const auto mosaic = open(folder_ / "layers/orthomosaic.tif");
  ASSERT_EQ(mosaic->GetRasterCount(), 4);
  EXPECT_GE(mosaic->GetRasterBand(1)->GetOverviewCount(), 1);
  EXPECT_EQ(mosaic->GetRasterBand(4)->GetColorInterpretation(), GCI_AlphaBand);
  double t[6];
  mosaic->GetGeoTransform(t);
  for (const auto& [north, east] : {std::pair{0.1, 5.1}, {3.3, 0.7}, {6.0, 6.0}, {1.9, 2.3}}) {
    std::array<std::uint8_t, 4> pixel{};
    ASSERT_EQ(mosaic->RasterIO(GF_Read, static_cast<int>((east - t[0]) / t[1]),
                               static_cast<int>((north - t[3]) / t[5]), 1, 1, pixel.data(), 1, 1, GDT_Byte, 4,
                               nullptr, 4, 4, 1, nullptr),
              CE_None);
    // Vertices every 0.264 m carry the centimetres of their place, modulo 256; between them linear, but
    // where the byte wraps.
    EXPECT_NEAR(pixel[0], std::fmod(north * 100, 256), 2);
    EXPECT_EQ(pixel[2], 7);
    EXPECT_EQ(pixel[3], 255);
  }
}

TEST_F(LayerSet, DerivedLayersHaveNoSeamsWhereBlocksMeet) {
  config_.cells = {0.0066, 0.05};  // 320 cells a tile: blocks of 512 cut tiles anywhere
  config_.slope_window = 0.06;
  config_.rugosity_window = 0.2;
  config_.picture_pixels = 0;
  const auto bumpy = [](double n, double e) { return 4 + 0.1 * std::sin(5 * n) * std::cos(7 * e); };
  tiles({0, 0, 2, 3}, 0.033, bumpy);
  (void)writeLayers(folder_, inputs_, config_);
  // All of it as one block.
  PatchMosaic mosaic(inputs_.grid, config_.cells, inputs_.tiles, inputs_.patch);
  const CellWindow all = mosaic.surfaceExtent();
  const int radius = radiusOf(config_.rugosity_window, config_.cells.surface);
  const CellWindow wide{all.x - radius, all.y - radius, all.rows + 2 * radius, all.columns + 2 * radius};
  const auto surface = mosaic.surface(wide);
  const TerrainView view{surface.elevation.data(), all.rows, all.columns, radius, config_.cells.surface};
  const auto slope = slopeAspect(view, {radiusOf(config_.slope_window, config_.cells.surface), 0.5}).slope;
  const auto rough = rugosity(view, {radius, 0.5});
  for (const auto& [name, expected] : {std::pair{"slope", &slope}, {"rugosity", &rough}}) {
    const auto file = open(folder_ / "layers" / (std::string(name) + ".tif"));
    ASSERT_TRUE(file);
    ASSERT_EQ(file->GetRasterXSize(), all.columns);
    ASSERT_GT(all.columns, 512);
    ASSERT_GT(all.rows, 512);
    std::vector<float> got(all.cells());
    ASSERT_EQ(file->GetRasterBand(1)->RasterIO(GF_Read, 0, 0, all.columns, all.rows, got.data(), all.columns,
                                               all.rows, GDT_Float32, 0, 0, nullptr),
              CE_None);
    for (std::int32_t row = 0; row < all.rows; ++row)
      for (std::int32_t column = 0; column < all.columns; ++column) {
        const float value = got[all.at(all.rows - 1 - row, column)], truth = (*expected)[all.at(row, column)];
        ASSERT_EQ(std::isnan(value), std::isnan(truth)) << name << ' ' << row << ' ' << column;
        if (!std::isnan(truth)) {
          ASSERT_NEAR(value, truth, expected == &slope ? 0.5 / 64 : 0.5 / 8192)
              << name << ' ' << row << ' ' << column;
        }
      }
  }
}

TEST_F(LayerSet, StatisticsAndTheTrackAreLayersToo) {
  fusion::CellStatistics statistics;
  for (const double z : {7.0, 7.05}) {
    Mesh mesh;
    mesh.vertices = {{0, 0, static_cast<float>(z)},
                     {0, 2, static_cast<float>(z)},
                     {2, 2, static_cast<float>(z)},
                     {2, 0, static_cast<float>(z)}};
    mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
    statistics.add(mesh);
  }
  std::vector<DiveTrackPoint> track;
  for (int k = 0; k < 40; ++k) {
    DiveTrackPoint point;
    point.utc_ns = k;
    point.T_nav_body = SE3(Eigen::Quaterniond::Identity(), {10 + 0.5 * k, 20, 5});
    point.altitude = 2 + 0.01 * k;
    point.water[static_cast<std::size_t>(WaterProperty::kTemperature)] = 11.5;
    track.push_back(point);
  }
  inputs_.statistics = &statistics;
  inputs_.track = &track;
  const auto layers = writeLayers(folder_, inputs_, config_);
  std::vector<std::string> names;
  for (const LayerInfo& layer : layers) names.push_back(layer.name);
  EXPECT_EQ(names, (std::vector<std::string>{"meshes", "deviation", "altitude", "temperature"}));
  const auto meshes = open(folder_ / "layers/meshes.tif"), deviation = open(folder_ / "layers/deviation.tif"),
             altitude = open(folder_ / "layers/altitude.tif"),
             temperature = open(folder_ / "layers/temperature.tif");
  ASSERT_TRUE(meshes && deviation && altitude && temperature);
  EXPECT_EQ(at(*meshes, 1, 1), 2);
  EXPECT_EQ(layers[0].min, 0);
  EXPECT_EQ(layers[0].max, 2);
  EXPECT_NEAR(layers[2].min, 2, 0.02);  // 2 to 2.39 m, without the tails
  EXPECT_NEAR(layers[2].max, 2.39, 0.02);
  EXPECT_NEAR(at(*deviation, 1, 1), 0.05 / std::sqrt(2), 1e-4);
  EXPECT_NEAR(at(*altitude, 20, 20.3), 2.2, 0.011);
  EXPECT_NEAR(at(*temperature, 20, 19.6), 11.5, 1e-4);
}

TEST(LayerFiles, KnowsEveryLayerAndNothingElse) {
  const auto known = [](const std::string& name) {
    return fnmatch(std::string(kLayerFiles).c_str(), ("layers/" + name).c_str(),
                   FNM_PATHNAME | FNM_EXTMATCH) == 0;
  };
  for (std::size_t k = 0; k < kWaterProperties; ++k)
    EXPECT_TRUE(known(infoOf(static_cast<WaterProperty>(k)).name + std::string(".tif"))) << k;
  for (const std::string name : {"elevation", "orthomosaic", "slope", "aspect", "rugosity", "views",
                                 "uncertainty", "meshes", "deviation", "altitude"}) {
    EXPECT_TRUE(known(name + ".tif")) << name;
    EXPECT_TRUE(known(name + ".png")) << name;
  }
  EXPECT_FALSE(known("mine.tif"));
  EXPECT_FALSE(known("slope.tif.aux.xml"));
}

TEST_F(LayerSet, TheSameInputsGiveTheSameBytesWithAnyThreads) {
  config_.cells.mosaic = 0.01;
  tiles({0, 0, 2, 2}, 0.264, fallingPlane);
  const auto bytesOf = [&](const std::string& file) { return fathom::test::readText(folder_ / file); };
  std::vector<std::string> first;
  for (const LayerInfo& layer : writeLayers(folder_, inputs_, config_)) first.push_back(bytesOf(layer.file));
  const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
  std::reverse(inputs_.tiles.begin(), inputs_.tiles.end());
  std::size_t k = 0;
  for (const LayerInfo& layer : writeLayers(folder_, inputs_, config_))
    EXPECT_EQ(first.at(k++), bytesOf(layer.file)) << layer.name;
}

TEST_F(LayerSet, NothingGivesNoLayersAndAFullDiskIsReported) {
  EXPECT_TRUE(writeLayers(folder_, inputs_, config_).empty());
  tiles({0, 0, 1, 1}, 0.264, fallingPlane);
  inputs_.patch = [](const TileId&) { return std::vector<std::uint8_t>{}; };
  const auto layers = writeLayers(folder_, inputs_, config_);
  EXPECT_TRUE(layers.empty());
  EXPECT_TRUE(std::filesystem::is_empty(folder_ / "layers"));
  RasterSource source;
  source.extent = {0, 0, 4, 4};
  source.cell = 1;
  source.touches = [](const CellWindow&) { return true; };
  source.fill = [](const CellWindow& w, void* out) { std::fill_n(static_cast<float*>(out), w.cells(), 1.F); };
  EXPECT_THROW(writeCog("/proc/no/such/folder/x.tif", source, {kGridOrigin, "", "", true, 0}),
               std::runtime_error);
  EXPECT_THROW((void)readReduced(folder_ / "none.tif", 100), std::runtime_error);
}

// A program that is killed meanwhile leaves what the next one may take away.
TEST_F(LayerSet, WhatIsHalfWrittenSaysSoInItsName) {
  RasterSource source;
  source.extent = {0, 0, 2 * kCogBlock, 2 * kCogBlock};
  source.cell = 1;
  source.touches = [](const CellWindow&) { return true; };
  int seen = 0;
  source.fill = [&](const CellWindow& w, void* out) {
    std::fill_n(static_cast<float*>(out), w.cells(), 1.F);
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      EXPECT_NE(entry.path().filename().string().find(".tmp"), std::string::npos) << entry.path();
      ++seen;
    }
  };
  writeCog(folder_ / "x.tif", source, {kGridOrigin, "", "", true, 0});
  EXPECT_GE(seen, 4);
}

}  // namespace
}  // namespace fathom::topside
