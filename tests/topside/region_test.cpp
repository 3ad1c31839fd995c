// A model that keeps to polygons somebody drew.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cpl_error.h>
#include <gdal_priv.h>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply_reader.hpp"
#include "recon/products/tiles/check/tile_check.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/reef_quick.hpp"

namespace fathom::topside {
namespace {

using testing::HasSubstr;

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
