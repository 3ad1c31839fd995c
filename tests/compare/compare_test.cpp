#include "recon/compare/compare.hpp"
#include "realtime/base/units.hpp"

#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/compare/difference.hpp"
#include "recon/geometry/ply_reader.hpp"
#include "recon/geometry/ply_writer.hpp"
#include "recon/topside/commands/compare_command.hpp"
#include "recon/topside/report/compare_report.hpp"
#include "tests/compare/synthetic_terrain.hpp"
#include "tests/support/lattice_mesh.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::compare {
namespace {

using test::mapOf;
using test::roughHeight;

const Geodetic kOrigin{-23.44 * kRadiansPerDegree, 151.91 * kRadiansPerDegree};

// A dive's mesh over 16 x 12 m with a pose file that states its origin.
class Compare : public testing::Test {
 protected:
  // Heights(east, north), every 10 cm.
  template <typename Height>
  void writeDive(const std::filesystem::path& folder, const Geodetic& origin, const Height& height) const {
    std::filesystem::create_directories(folder);
    Mesh mesh;
    constexpr int kEast = 160, kNorth = 120;
    for (int n = 0; n <= kNorth; ++n)
      for (int e = 0; e <= kEast; ++e) {
        const double east = -8 + 0.1 * e, north = -6 + 0.1 * n;
        mesh.vertices.emplace_back(north, east, -height(east, north));
        mesh.sigma.push_back(0.01F);
      }
    mesh.triangles = fathom::test::latticeTriangles(kNorth + 1, kEast + 1);
    writePly(folder / "mesh.ply", mesh);
    io::writeStereoPoses(folder / "stereo_pose_est.data", {origin, {}});
  }

  [[nodiscard]] CompareOptions options(const std::filesystem::path& reference,
                                       const std::string& crs = "") const {
    CompareOptions o;
    o.beside = topside::frameBeside;
    o.survey = folder_ / "dive";
    o.reference = reference;
    o.reference_crs = crs;
    o.reference_up = "auto";
    o.registration.max_shift = 3;
    return o;
  }

  void expectInputError(const CompareOptions& o, const std::string& words) const {
    EXPECT_THAT(fathom::test::refusal([&] { (void)compareSurfaces(o); }), testing::HasSubstr(words))
        << o.reference;
  }

  const fathom::test::TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path();
};

TEST_F(Compare, TakesXyzTextOfDepthsInGeographicDegrees) {
  // The dive is 0.55 m too far east and 0.3 m too low; the reference: longitude, latitude, depth every 25 cm.
  writeDive(folder_ / "dive", kOrigin, [](double e, double n) { return roughHeight(e - 0.55, n) - 0.3; });
  const LocalTransverseMercator local(kOrigin);
  std::ofstream xyz(folder_ / "multibeam.xyz");
  xyz.precision(12);
  xyz << "longitude latitude depth\n";
  for (int n = -48; n <= 48; ++n)
    for (int e = -60; e <= 60; ++e) {
      const Geodetic g = local.toGeodetic({0.25 * n, 0.25 * e});
      xyz << g.longitude / kRadiansPerDegree << ' ' << g.latitude / kRadiansPerDegree << ' '
          << -roughHeight(0.25 * e, 0.25 * n) << '\n';
    }
  xyz.close();
  const Comparison c = compareSurfaces(options(folder_ / "multibeam.xyz", "EPSG:4326"));
  EXPECT_TRUE(c.reference_turned);
  ASSERT_EQ(c.registration.directions_resolved, 2);
  EXPECT_NEAR(c.cell, 0.25, 0.02);
  EXPECT_NEAR(c.registration.offset.shift.x(), -0.55, 0.02);
  EXPECT_NEAR(c.registration.offset.shift.y(), 0.0, 0.02);
  EXPECT_NEAR(c.registration.offset.shift.z(), 0.3, 0.005);
  EXPECT_LT(c.difference.after.rms, 0.03);
  EXPECT_GT(c.difference.before.rms, 0.3);
}

TEST_F(Compare, TakesAGeoTiffInAnotherProjectionAndWritesEveryResult) {
  writeDive(folder_ / "dive", kOrigin, [](double e, double n) { return roughHeight(e, n + 0.42); });
  const PlaneFrame utm = frameFrom("EPSG:32756", "test");
  const PlaneTransform to_utm(localFrame(kOrigin), utm), back(utm, localFrame(kOrigin));
  const Box box = to_utm.apply(Box{-14, -12, 14, 12});
  HeightMap map(box, 0.2);
  for (int row = 0; row < map.rows; ++row)
    for (int column = 0; column < map.columns; ++column) {
      std::vector<double> x{map.eastOf(column)}, y{map.northOf(row)};
      back.apply(x, y);
      map.up[map.index(column, row)] = static_cast<float>(roughHeight(x[0], y[0]));
    }
  writeGeoTiff(map, utm, folder_ / "multibeam.tif");
  const Comparison c = compareSurfaces(options(folder_ / "multibeam.tif"));
  ASSERT_EQ(c.registration.directions_resolved, 2);
  EXPECT_FALSE(c.reference_turned);
  EXPECT_NEAR(c.registration.offset.shift.x(), 0.0, 0.01);
  EXPECT_NEAR(c.registration.offset.shift.y(), 0.42, 0.01);
  EXPECT_LT(c.difference.after.rms, 0.02);
  EXPECT_FALSE(c.difference.by_sigma.empty());

  const auto out = folder_ / "out";
  std::filesystem::create_directories(out);
  topside::writeComparison(c, out);
  for (const char* name : {"difference.png", "survey.png", "reference.png", "compare.html"})
    EXPECT_GT(std::filesystem::file_size(out / name), 500U) << name;
  const auto json = nlohmann::json::parse(std::ifstream(out / "compare.json"));
  EXPECT_NEAR(json["offset"]["north_m"].get<double>(), 0.42, 0.01);
  EXPECT_EQ(json["offset"]["horizontal_directions_told"], 2);
  GDALAllRegister();
  GDALDataset* tif = GDALDataset::Open((out / "difference.tif").c_str());
  ASSERT_NE(tif, nullptr);
  EXPECT_EQ(tif->GetRasterXSize(), c.difference.map.columns);
  double transform[6];
  tif->GetGeoTransform(transform);
  EXPECT_NEAR(transform[3], c.survey.north + c.registration.offset.shift.y(), 1e-6);
  EXPECT_NE(std::string(tif->GetProjectionRef()).find("Mercator"), std::string::npos);
  GDALClose(tif);
}

TEST_F(Compare, TakesAnotherDiveWithAnotherOrigin) {
  writeDive(folder_ / "dive", kOrigin, roughHeight);
  // The other dive's origin is 3 m to the north and 2 m to the east; its map has an error of its own.
  const LocalTransverseMercator local(kOrigin);
  const Geodetic there = local.toGeodetic({3.0, 2.0});
  writeDive(folder_ / "other", there,
            [](double e, double n) { return roughHeight(e + 2.0 - 0.2, n + 3.0) + 0.1; });
  const Comparison c = compareSurfaces(options(folder_ / "other"));
  ASSERT_EQ(c.registration.directions_resolved, 2);
  EXPECT_NEAR(c.registration.offset.shift.x(), 0.2, 0.01);
  EXPECT_NEAR(c.registration.offset.shift.y(), 0.0, 0.01);
  EXPECT_NEAR(c.registration.offset.shift.z(), 0.1, 0.005);
  EXPECT_LT(c.difference.overlap_m2, c.difference.survey_m2);
}

TEST_F(Compare, RefusesWhatItCannotCompareInOneLine) {
  writeDive(folder_ / "dive", kOrigin, roughHeight);
  expectInputError(options(folder_ / "nothing.tif"), "absent");
  std::ofstream(folder_ / "words.xyz") << "these are\nno numbers\nat all\n";
  expectInputError(options(folder_ / "words.xyz"), "x y z");
  std::ofstream(folder_ / "empty.xyz").close();
  expectInputError(options(folder_ / "empty.xyz"), "fewer than four points");
  std::ofstream(folder_ / "nonsense.tif") << "II*\0nonsense";
  expectInputError(options(folder_ / "nonsense.tif"), "no raster");
  std::ofstream(folder_ / "far.xyz") << "1000 1000 -5\n1001 1000 -5\n1000 1001 -5\n1001 1001 -5\n";
  expectInputError(options(folder_ / "far.xyz"), "is elsewhere");
  expectInputError(options(folder_ / "far.xyz", "EPSG:nonsense"), "coordinate reference system");
  std::filesystem::create_directories(folder_ / "hollow");
  expectInputError(options(folder_ / "hollow"), "neither");
}

}  // namespace
}  // namespace fathom::compare
