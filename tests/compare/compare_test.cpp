#include <gdal_priv.h>
#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/compare.hpp"
#include "recon/compare/surface_registration.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/report/compare_report.hpp"
#include "tests/support/lattice_mesh.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/world/ground.hpp"

namespace fathom::compare {
namespace {

using test::mapOf, test::roughHeight;

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

constexpr Box kSurvey{-10, -8, 10, 8};
constexpr Box kReference{-18, -16, 18, 16};
constexpr double kCell = 0.25;

TEST(SurfaceRegistration, FindsAKnownShiftWithinItsOwnUncertainty) {
  // The survey is 1.37 m too far west and 0.62 m too far north of the truth, and 0.8 m too high.
  const HeightMap survey = mapOf(
      kSurvey, kCell, [](double e, double n) { return roughHeight(e + 1.37, n - 0.62) + 0.8; }, 0.02, 1);
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.03, 2);
  const SurfaceRegistration r = registerMaps(survey, reference, {});
  ASSERT_EQ(r.directions_resolved, 2);
  const Eigen::Vector3d truth(1.37, -0.62, -0.8);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(r.offset.shift[k], truth[k], 4 * r.sigma[k] + 0.002) << k;
    EXPECT_LT(r.sigma[k], 0.02) << k;
    EXPECT_GT(r.sigma[k], 1e-5) << k;
  }
  EXPECT_GT(r.correlation, 0.95);
  EXPECT_FALSE(r.at_limit);
}

TEST(SurfaceRegistration, ItsUncertaintyIsThatOfItsErrorOverManyNoises) {
  constexpr int kRuns = 30;
  double squares = 0;
  for (std::uint64_t run = 0; run < kRuns; ++run) {
    const HeightMap survey = mapOf(
        kSurvey, 0.5, [](double e, double n) { return roughHeight(e + 0.3, n); }, 0.04, 2 * run + 10);
    const HeightMap reference = mapOf(kReference, 0.5, roughHeight, 0.04, 2 * run + 11);
    const SurfaceRegistration r = registerMaps(survey, reference, {.max_shift = 2});
    ASSERT_EQ(r.directions_resolved, 2);
    squares += std::pow((r.offset.shift.x() - 0.3) / r.sigma.x(), 2);
  }
  const double ratio = std::sqrt(squares / kRuns);
  EXPECT_GT(ratio, 0.6);
  EXPECT_LT(ratio, 1.6);
}

TEST(SurfaceRegistration, LeavesTheHorizontalOffsetOfAFlatNoisySeafloorUnresolved) {
  const auto flat = [](double, double) { return -12.0; };
  const HeightMap survey = mapOf(
      kSurvey, kCell, [](double, double) { return -11.5; }, 0.03, 3);
  const HeightMap reference = mapOf(kReference, kCell, flat, 0.03, 4);
  const SurfaceRegistration r = registerMaps(survey, reference, {});
  EXPECT_EQ(r.directions_resolved, 0);
  EXPECT_EQ(r.offset.shift.x(), 0);
  EXPECT_EQ(r.offset.shift.y(), 0);
  EXPECT_TRUE(std::isinf(r.sigma.x()));
  EXPECT_NEAR(r.offset.shift.z(), -0.5, 0.005);
  EXPECT_NE(r.note.find("too flat"), std::string::npos);
}

TEST(SurfaceRegistration, HoldsTheOffsetAlongParallelRipples) {
  // Crests run along bearing 30 degrees.
  const auto ripples = [](double e, double n) {
    const double across = e * std::cos(std::numbers::pi / 6) - n * std::sin(std::numbers::pi / 6);
    return -9 + 0.2 * std::sin(0.8 * across) + 0.1 * std::sin(1.9 * across + 1) +
           0.15 * std::sin(0.33 * across);
  };
  const double moved = 0.7;  // across the crests [m]
  const HeightMap survey = mapOf(
      kSurvey, kCell,
      [&](double e, double n) {
        return ripples(e + moved * std::cos(std::numbers::pi / 6),
                       n - moved * std::sin(std::numbers::pi / 6));
      },
      0.01, 5);
  const HeightMap reference = mapOf(kReference, kCell, ripples, 0.01, 6);
  const SurfaceRegistration r = registerMaps(survey, reference, {.max_shift = 3});
  ASSERT_EQ(r.directions_resolved, 1);
  EXPECT_NEAR(r.open_bearing, std::numbers::pi / 6, 0.1);
  const Eigen::Vector2d across(std::cos(std::numbers::pi / 6), -std::sin(std::numbers::pi / 6));
  EXPECT_NEAR(r.offset.shift.head<2>().dot(across), moved, 0.02);
}

TEST(SurfaceRegistration, IsRobustToATenthOfWrongHeights) {
  HeightMap survey = mapOf(
      kSurvey, kCell, [](double e, double n) { return roughHeight(e - 0.9, n + 0.4); }, 0.01, 7);
  for (std::size_t i = 0; i < survey.up.size(); i += 10) survey.up[i] += 1.5F;
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.01, 8);
  const SurfaceRegistration r = registerMaps(survey, reference, {});
  ASSERT_EQ(r.directions_resolved, 2);
  EXPECT_NEAR(r.offset.shift.x(), -0.9, 0.01);
  EXPECT_NEAR(r.offset.shift.y(), 0.4, 0.01);
  EXPECT_NEAR(r.offset.shift.z(), 0.0, 0.01);
}

TEST(SurfaceRegistration, FindsATiltWhenAskedFor) {
  const HeightMap survey = mapOf(
      kSurvey, kCell, [](double e, double n) { return roughHeight(e + 0.5, n) - 0.02 * e + 0.01 * n; }, 0.01,
      9);
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.01, 10);
  const SurfaceRegistration r = registerMaps(survey, reference, {.max_shift = 2, .tilt = true});
  ASSERT_EQ(r.directions_resolved, 2);
  EXPECT_NEAR(r.offset.tilt.x(), 0.02, 0.001);
  EXPECT_NEAR(r.offset.tilt.y(), -0.01, 0.001);
  EXPECT_NEAR(r.offset.shift.x(), 0.5, 0.02);
}

TEST(Difference, HasItsStatisticsBySlopeAndByStatedSigma) {
  HeightMap survey = mapOf(kSurvey, kCell, roughHeight, 0.0, 0);
  survey.sigma.assign(survey.up.size(), 0.01F);
  for (int row = 0; row < survey.rows; ++row)
    for (int column = 0; column < survey.columns; ++column) {
      // Half of the cells are claimed to be, and are, five times as uncertain.
      const std::size_t at = survey.index(column, row);
      if (column % 2 == 0) survey.sigma[at] = 0.05F;
      survey.up[at] +=
          static_cast<float>(static_cast<double>(survey.sigma[at]) * test::noiseAt(column, row, 11)) + 0.1F;
    }
  const HeightMap reference = mapOf(kReference, kCell, roughHeight, 0.0, 0);
  RegistrationOffset offset;
  offset.shift.z() = -0.1;
  const Difference d = differenceOf(survey, reference, offset);
  EXPECT_EQ(d.after.cells, survey.up.size());
  EXPECT_NEAR(d.before.bias, 0.1, 0.002);
  EXPECT_NEAR(d.after.bias, 0.0, 0.002);
  EXPECT_NEAR(d.after.rms, std::sqrt(0.5 * (0.01 * 0.01 + 0.05 * 0.05)), 0.003);
  ASSERT_EQ(d.by_sigma.size(), 4U);
  for (const DifferenceClass& k : d.by_sigma) EXPECT_NEAR(k.rms_over_sigma, 1.0, 0.1);
  std::size_t by_slope = 0;
  for (const DifferenceClass& k : d.by_slope) by_slope += k.statistics.cells;
  EXPECT_EQ(by_slope, d.after.cells);
  EXPECT_GT(d.by_slope.size(), 2U);
  EXPECT_NEAR(d.overlap_m2, 20 * 16, 1);
}

}  // namespace
}  // namespace fathom::compare
