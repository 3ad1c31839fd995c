#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"
#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/export/geo_raster.hpp"
#include "tests/monitor/sample_dive.hpp"
#include "tests/monitor/synthetic_blocks.hpp"

namespace fathom::monitor {
namespace {

// A GeoTIFF as other programs read it.
class Tiff {
 public:
  explicit Tiff(std::string bytes) : bytes_(std::move(bytes)) {
    GDALAllRegister();
    VSIFCloseL(VSIFileFromMemBuffer("/vsimem/test.tif", reinterpret_cast<GByte*>(bytes_.data()),
                                    bytes_.size(), FALSE));
    dataset_ = GDALDataset::FromHandle(GDALOpen("/vsimem/test.tif", GA_ReadOnly));
  }
  ~Tiff() {
    GDALClose(dataset_);
    VSIUnlink("/vsimem/test.tif");
  }
  [[nodiscard]] GDALDataset& data() const { return *dataset_; }
  // The value of the pixel at a latitude and longitude; NaN outside.
  [[nodiscard]] double at(int band, const Geodetic& place) const {
    OGRSpatialReference wgs84;
    wgs84.importFromEPSG(4326);
    wgs84.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    OGRSpatialReference own(*dataset_->GetSpatialRef());
    own.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    auto* transform = OGRCreateCoordinateTransformation(&wgs84, &own);
    double x = place.longitude / kRadiansPerDegree, y = place.latitude / kRadiansPerDegree;
    transform->Transform(1, &x, &y);
    OGRCoordinateTransformation::DestroyCT(transform);
    std::array<double, 6> t{};
    dataset_->GetGeoTransform(t.data());
    const int column = static_cast<int>(std::floor((x - t[0]) / t[1])),
              row = static_cast<int>(std::floor((y - t[3]) / t[5]));
    if (column < 0 || row < 0 || column >= dataset_->GetRasterXSize() || row >= dataset_->GetRasterYSize())
      return std::nan("");
    double value = 0;
    EXPECT_EQ(
        dataset_->GetRasterBand(band)->RasterIO(GF_Read, column, row, 1, 1, &value, 1, 1, GDT_Float64, 0, 0),
        CE_None);
    return value;
  }

 private:
  std::string bytes_;
  GDALDataset* dataset_ = nullptr;
};

TEST(GeoRaster, TheZoneIsThatOfTheOrigin) {
  EXPECT_EQ(epsgOf({-27.5 * kRadiansPerDegree, 153.5 * kRadiansPerDegree}), 32756);
  EXPECT_EQ(epsgOf({60 * kRadiansPerDegree, -0.1 * kRadiansPerDegree}), 32630);
  EXPECT_EQ(epsgOf({1 * kRadiansPerDegree, 180 * kRadiansPerDegree}), 32601);
  EXPECT_EQ(epsgOf({-1 * kRadiansPerDegree, -180 * kRadiansPerDegree}), 32701);
  EXPECT_EQ(epsgOf({85 * kRadiansPerDegree, 0}), 32661);
  EXPECT_EQ(epsgOf({-81 * kRadiansPerDegree, 0}), 32761);
}

// Far from the middle of the zone, where UTM's north is turned most against nav's, and far from the origin.
TEST(GeoRaster, AKnownNodeIsAtItsLatitudeAndLongitude) {
  for (const Geodetic origin : {Geodetic{-33.9 * kRadiansPerDegree, 155.9 * kRadiansPerDegree},
                                Geodetic{59.4 * kRadiansPerDegree, 10.6 * kRadiansPerDegree}}) {
    BlockStore store;
    Surface surface(store);
    const std::int32_t far = 3000;  // blocks of 1 m: 3 km north of the origin
    for (int n = -12; n < 12; ++n)
      for (int e = -12; e < 12; ++e) {
        auto block = syntheticBlock(kQuarterMetre, far + n, e);
        for (float& depth : block.depth) depth = 30;
        if (n == 4 && e == -7) {  // one node stands out
          block.depth[5] = 25;
          block.colour[5] = {250, 10, 10};
        }
        ASSERT_TRUE(store.put(block, {1, 0.05, true, 1}));
      }
    const auto raster = rasterOf(store, surface, origin);
    ASSERT_TRUE(raster);
    EXPECT_EQ(raster->pixel, 0.25);
    const Tiff elevation(elevationTiff(*raster)), colour(colourTiff(*raster));
    EXPECT_STREQ(elevation.data().GetRasterBand(1)->GetUnitType(), "m");
    EXPECT_EQ(elevation.data().GetSpatialRef()->GetAuthorityCode(nullptr), std::to_string(epsgOf(origin)));

    const LocalTransverseMercator local(origin);
    const double north = far + 4 + 0.25, east = -7 + 0.25;
    // The pixel's centre is up to 0.7 cells from the node, where the tent of one cell is still 1 m high.
    EXPECT_GT(elevation.at(1, local.toGeodetic({north, east})), -29);
    EXPECT_GT(colour.at(1, local.toGeodetic({north, east})), 110);
    double highest = -1e9;
    for (const double dn : {-0.9, 0.9})
      for (const double de : {-0.9, 0.9})
        highest = std::max(highest, elevation.at(1, local.toGeodetic({north + dn, east + de})));
    EXPECT_NEAR(highest, -30, 1e-4);
    EXPECT_TRUE(std::isnan(elevation.at(1, local.toGeodetic({north + 9, east}))));
    EXPECT_EQ(colour.at(4, local.toGeodetic({north, east})), 255);
    // The corners of the map are in it.
    for (const double n : {far - 12 + 0.2, far + 12 - 0.5})
      for (const double e : {-12 + 0.2, 12 - 0.5})
        EXPECT_NEAR(elevation.at(1, local.toGeodetic({n, e})), -30, 1e-4);
  }
}

TEST(GeoRaster, TwoBlocksFarApartMakeACoarseRasterAndNotAHugeOne) {
  BlockStore store;
  Surface surface(store);
  for (const std::int32_t far : {-20000, 20000}) {
    auto block = syntheticBlock(kQuarterMetre, far, far);
    for (float& depth : block.depth) depth = 30;
    ASSERT_TRUE(store.put(block, {1, 0.05, true, 1}));
  }
  const auto raster = rasterOf(store, surface, {-0.5, 2.6});
  ASSERT_TRUE(raster);
  EXPECT_LE(std::int64_t{raster->width} * raster->height, kMaxPixels);
  EXPECT_GT(raster->pixel, 1);
}

TEST(Exports, SayWhatIsMissing) {
  ModelView view;
  for (const auto name : kExportNames) {
    const Export file = makeExport(view, name);
    EXPECT_TRUE(file.bytes.empty());
    EXPECT_FALSE(file.why.empty()) << name;
  }
}

TEST(Exports, TheTrackIsGeoJsonInDegrees) {
  SampleDive dive;
  dive.duration_s = 200;
  dive.loss = 0;
  MonitorModel model;
  dive.run([&](std::int64_t utc_ns, std::span<const std::uint8_t> frame) { model.accept(frame, utc_ns); });
  ModelView view;
  view.take(model);
  const auto geo = nlohmann::json::parse(makeExport(view, "track.geojson").bytes);
  ASSERT_EQ(geo["features"].size(), 2U);
  const auto& line = geo["features"][0]["geometry"]["coordinates"];
  EXPECT_EQ(line.size(), model.track().size());
  const LocalTransverseMercator local({-0.4, 2.65});
  const auto& first = model.track().begin()->second;
  const Geodetic expected = local.toGeodetic({first.north, first.east});
  EXPECT_NEAR(line[0][0].get<double>(), expected.longitude / kRadiansPerDegree, 2e-7);
  EXPECT_NEAR(line[0][1].get<double>(), expected.latitude / kRadiansPerDegree, 2e-7);
  EXPECT_NEAR(line[0][2].get<double>(), -first.depth, 1e-6);
  EXPECT_EQ(makeExport(view, "map.ply").bytes.rfind("ply\n", 0), 0U);
}

}  // namespace
}  // namespace fathom::monitor
