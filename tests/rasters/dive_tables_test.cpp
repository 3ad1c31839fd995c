#include "recon/products/tables/dive_tables.hpp"
#include "realtime/base/units.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "tests/support/test_data.hpp"

namespace fathom::topside {
namespace {

const Geodetic kOrigin{40.5 * kRadiansPerDegree, -70.25 * kRadiansPerDegree};

class DiveTables : public ::testing::Test {
 protected:
  [[nodiscard]] std::vector<std::vector<std::string>> table(const std::string& name) const {
    std::ifstream in(folder_ / name);
    std::vector<std::vector<std::string>> rows;
    for (std::string line; std::getline(in, line);) {
      rows.emplace_back();
      std::string field;
      bool quoted = false;
      for (std::size_t k = 0; k <= line.size(); ++k) {
        if (k == line.size() || (line[k] == ',' && !quoted)) {
          rows.back().push_back(field);
          field.clear();
        } else if (line[k] == '"') {
          if (quoted && k + 1 < line.size() && line[k + 1] == '"')
            field += line[k++];
          else
            quoted = !quoted;
        } else {
          field += line[k];
        }
      }
    }
    return rows;
  }
  // Of the first row below the head.
  static std::string field(const std::vector<std::vector<std::string>>& rows, const std::string& name) {
    for (std::size_t k = 0; k < rows[0].size(); ++k)
      if (rows[0][k] == name) return rows[1].at(k);
    ADD_FAILURE() << name;
    return {};
  }
  [[nodiscard]] nlohmann::json json(const std::string& name) const {
    std::ifstream in(folder_ / name);
    return nlohmann::json::parse(in);
  }

  const fathom::test::TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path();
};

ImageRow image(double north, double east) {
  ImageRow row;
  row.left = "PR_20260101_000000_250_LC16.tif";
  row.right = "PR_20260101_000000_250_RM16.tif";
  row.utc_ns = 1767225600 * kSecond_ns + 250'000'000;
  row.T_nav_body = SE3::fromEuler(0.01, -0.02, -90 * kRadiansPerDegree, {north, east, 25});
  row.T_nav_cam = SE3::fromEuler(0.01, -0.02, -90 * kRadiansPerDegree, {north, east, 25.5});
  row.altitude = 2.25;
  row.footprint = {{0, 0, 27}, {0, 2, 27}, {1.5, 2, 27}, {1.5, 0, 27}};
  row.water[static_cast<std::size_t>(WaterProperty::kTemperature)] = 12.5;
  return row;
}

TEST_F(DiveTables, ImagesStandWhereTheCameraWasInEveryTable) {
  const auto names = writeImageTables(folder_, kOrigin, {image(120, -45)});
  EXPECT_EQ(names.size(), 4U);
  const Geodetic place = LocalTransverseMercator(kOrigin).toGeodetic({120, -45});
  const auto expectPlace = [&](const std::string& latitude, const std::string& longitude) {
    EXPECT_NEAR(std::stod(latitude), place.latitude / kRadiansPerDegree, 1e-8);
    EXPECT_NEAR(std::stod(longitude), place.longitude / kRadiansPerDegree, 1e-8);
  };
  const auto full = table("images.csv"), squidle = table("images_squidle.csv"),
             catami = table("images_catami.csv"), biigle = table("images_biigle.csv");
  ASSERT_EQ(full.size(), 2U);
  ASSERT_EQ(full[0].size(), full[1].size());
  expectPlace(field(full, "latitude_deg"), field(full, "longitude_deg"));
  EXPECT_EQ(field(full, "utc"), "2026-01-01T00:00:00.250000Z");
  EXPECT_EQ(field(full, "utc_ns"), "1767225600250000000");
  EXPECT_EQ(field(full, "depth_m"), "25.500");
  EXPECT_EQ(field(full, "heading_deg"), "270.000");
  EXPECT_EQ(field(full, "footprint_m2"), "3.000");
  EXPECT_EQ(field(full, "temperature_c"), "12.50000");
  EXPECT_EQ(field(full, "conductivity_s_m"), "");
  expectPlace(field(squidle, "pose.lat"), field(squidle, "pose.lon"));
  EXPECT_EQ(field(squidle, "key"), "PR_20260101_000000_250_LC16");
  EXPECT_EQ(field(squidle, "pose.alt"), "2.250");
  EXPECT_EQ(field(squidle, "pose.dep"), "25.500");
  EXPECT_EQ(field(squidle, "timestamp_start"), "2026-01-01T00:00:00.250000");
  ASSERT_EQ(catami.size(), 1U);
  ASSERT_EQ(catami[0].size(), 13U);
  expectPlace(catami[0][1], catami[0][2]);
  EXPECT_EQ(catami[0][7], "12.5000");
  EXPECT_EQ(catami[0][8], "-999.0");
  EXPECT_NEAR(std::stod(catami[0][11]), -90 * kRadiansPerDegree, 1e-6);
  expectPlace(field(biigle, "lat"), field(biigle, "lng"));
  EXPECT_EQ(field(biigle, "gps_altitude"), "-25.500");
  EXPECT_EQ(field(biigle, "distance_to_ground"), "2.250");
}

TEST_F(DiveTables, StrangeFileNamesStayOneField) {
  ImageRow row = image(0, 0);
  row.left = "a,\"b\".tif";
  row.altitude.reset();
  (void)writeImageTables(folder_, kOrigin, {row});
  for (const std::string name : {"images.csv", "images_squidle.csv", "images_biigle.csv"}) {
    const auto rows = table(name);
    ASSERT_EQ(rows.size(), 2U) << name;
    EXPECT_EQ(rows[0].size(), rows[1].size()) << name;
  }
  EXPECT_EQ(table("images.csv")[1][0], row.left);
  row.left = "bad\xff\xfe.tif";
  writeImagesJson(folder_ / "images.json", {row}, Camera());
  EXPECT_EQ(json("images.json")["images"].size(), 1U);
}

TEST_F(DiveTables, WithoutATimeAndAPlaceOnEarthTheirFieldsAreEmpty) {
  ImageRow row = image(3, 4);
  row.utc_ns.reset();
  (void)writeImageTables(folder_, std::nullopt, {row});
  const auto full = table("images.csv"), catami = table("images_catami.csv");
  for (const char* column : {"utc", "utc_ns", "latitude_deg", "longitude_deg"})
    EXPECT_EQ(field(full, column), "") << column;
  EXPECT_EQ(field(full, "north_m"), "3.000");
  EXPECT_EQ(field(table("images_squidle.csv"), "pose.lat"), "");
  EXPECT_EQ(field(table("images_biigle.csv"), "taken_at"), "");
  EXPECT_EQ(catami[0][1], "-999.0");
  writeImagesJson(folder_ / "images.json", {row}, Camera());
  EXPECT_TRUE(json("images.json")["images"][0]["utc_ns"].is_null());
}

TEST_F(DiveTables, TheTrackTellsNullWhereNothingIsKnown) {
  std::vector<DiveTrackPoint> track(3);
  for (std::size_t k = 0; k < 3; ++k) track[k].utc_ns = static_cast<std::int64_t>(k) * kSecond_ns;
  track[1].T_nav_body = SE3::fromEuler(0, 0, 0.5, {1.23456, -2, 30});
  track[1].altitude = 1.9;
  track[1].water[static_cast<std::size_t>(WaterProperty::kSalinity)] = 35.1;
  nameStages(track, kSecond_ns, kSecond_ns);
  writeTrackJson(folder_ / "track.json", track, false);
  const auto read = json("track.json");
  EXPECT_FALSE(read["timed"].get<bool>());
  EXPECT_EQ(read["utc_ns"][1], "1000000000");
  EXPECT_TRUE(read["north"][0].is_null());
  EXPECT_EQ(read["north"][1], 1.235);
  EXPECT_TRUE(read["altitude"][2].is_null());
  EXPECT_EQ(read["stage"], nlohmann::json({"descent", "survey", "ascent"}));
  EXPECT_EQ(read["salinity_psu"][1], 35.1);
  EXPECT_FALSE(read.contains("temperature_c"));
}

TEST_F(DiveTables, ImagesJsonHoldsPosesAndTheCamera) {
  const Camera camera{1360, 1024, 1500, 1500, 679.5, 511.5};
  writeImagesJson(folder_ / "images.json", {image(3, 4)}, camera);
  const auto read = json("images.json");
  ASSERT_EQ(read["images"].size(), 1U);
  const auto& one = read["images"][0];
  EXPECT_EQ(one["left"], "PR_20260101_000000_250_LC16.tif");
  EXPECT_EQ(one["north"], 3);
  EXPECT_EQ(one["footprint"].size(), 4U);
  double norm = 0;
  for (const double q : one["q"]) norm += q * q;
  EXPECT_NEAR(norm, 1, 1e-7);
  EXPECT_EQ(read["camera"]["cx"], 679.5);
}

TEST(Footprint, ALevelCamerasFootprintIsItsFieldOfView) {
  const Camera camera{1000, 800, 1000, 1000, 499.5, 399.5};
  // Camera x to starboard (east), y aft (south), z down.
  Eigen::Matrix3d rotation;
  rotation << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const auto corners = footprintOnPlane(camera, SE3(rotation, {10, 20, 5}), 2);
  ASSERT_EQ(corners.size(), 4U);
  EXPECT_NEAR((corners[0] - Eigen::Vector3d(10.8, 19, 7)).norm(), 0, 1e-9);
  EXPECT_NEAR((corners[2] - Eigen::Vector3d(9.2, 21, 7)).norm(), 0, 1e-9);
  EXPECT_TRUE(footprintOnPlane(camera, SE3(rotation, {0, 0, 0}), 0).empty());
  // Looking to the horizon.
  const SE3 level = SE3::fromEuler(0, std::numbers::pi / 2, 0, {0, 0, 0}) * SE3(rotation, {0, 0, 0});
  EXPECT_TRUE(footprintOnPlane(camera, level, 2).empty());
}

TEST(WaterLog, ValuesAreLinearBetweenSamplesAndUnknownAcrossGaps) {
  std::vector<WaterSample> samples(3);
  samples[0].utc_ns = 100 * kSecond_ns;
  samples[0].temperature = 10;
  samples[0].conductivity = 4.0;
  samples[1] = samples[0];
  samples[1].utc_ns = 110 * kSecond_ns;
  samples[1].temperature = 11;
  samples[2] = samples[1];
  samples[2].utc_ns = 500 * kSecond_ns;
  const WaterLog log({samples[2], samples[0], samples[1]});
  const auto temperature = [&](std::int64_t s) {
    return log.at(s * kSecond_ns, 10)[static_cast<std::size_t>(WaterProperty::kTemperature)];
  };
  EXPECT_NEAR(temperature(105).value(), 10.5, 1e-9);
  EXPECT_NEAR(temperature(90).value(), 10, 1e-9);
  EXPECT_FALSE(temperature(10));
  EXPECT_FALSE(temperature(300));
  const auto salinity = log.at(105 * kSecond_ns, 10)[static_cast<std::size_t>(WaterProperty::kSalinity)];
  ASSERT_TRUE(salinity);
  EXPECT_GT(*salinity, 33);
  EXPECT_LT(*salinity, 40);
  EXPECT_TRUE(WaterLog({}).empty());
  EXPECT_FALSE(WaterLog({}).at(0, 0)[0]);
}

}  // namespace
}  // namespace fathom::topside
