#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <ogr_spatialref.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"
#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/web/page_api.hpp"
#include "telemetry/monitor/web/web_server.hpp"
#include "telemetry/web/access.hpp"
#include "tests/monitor/sample_dive.hpp"
#include "tests/support/http_client.hpp"

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
  SampleDive dive{.duration_s = 200, .loss = 0};
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

constexpr const char* kToken = "0123456789abcdef";

TEST(PageRequests, ReadWhatIsInBoundsAndNothingElse) {
  std::string why;
  const auto detail = parseRequest(
      R"({"kind":"detail","north_m":[1,9.5],"east_m":[-4,4],"spacing_m":0.125,"max_error_m":0.05})", why);
  ASSERT_TRUE(detail) << why;
  EXPECT_EQ(detail->kind, telemetry::Request::Kind::kDetail);
  EXPECT_EQ(detail->north_max, 9.5);
  EXPECT_EQ(parseRequest(R"({"kind":"rate","rate_bps":300})", why)->rate_bps, 300);
  EXPECT_TRUE(parseRequest(R"({"kind":"pause-map"})", why) && parseRequest(R"({"kind":"send-status"})", why));
  for (const char* bad :
       {"", "{", "[]", "null", "7", R"({"kind":"dive"})", R"({"kind":7})", R"({"kind":"rate"})",
        R"({"kind":"rate","rate_bps":"300"})", R"({"kind":"rate","rate_bps":1e999})",
        R"({"kind":"rate","rate_bps":-1})", R"({"kind":"detail"})",
        R"({"kind":"detail","north_m":[9,1],"east_m":[0,1],"spacing_m":0.25,"max_error_m":0.05})",
        R"({"kind":"detail","north_m":[0,1,2],"east_m":[0,1],"spacing_m":0.25,"max_error_m":0.05})",
        R"({"kind":"detail","north_m":[0,1],"east_m":[0,1],"spacing_m":0.3,"max_error_m":0.05})",
        R"({"kind":"detail","north_m":[0,5000],"east_m":[0,1],"spacing_m":0.25,"max_error_m":0.05})",
        R"({"kind":"pause-map","rudder":1})"}) {
    EXPECT_FALSE(parseRequest(bad, why)) << bad;
    EXPECT_FALSE(why.empty());
  }
  EXPECT_FALSE(parseRequest(std::string(R"({"kind":"pause-map")") + std::string(2000, ' ') + "}", why));
  EXPECT_FALSE(parseRequest(std::string(400, '['), why));
  EXPECT_EQ(parsePlayback(R"({"seek_utc_s":1000.5})", why)->seek_utc_ns, 1'000'500'000'000);
  EXPECT_FALSE(parsePlayback("{}", why) || parsePlayback(R"({"speed":-1})", why) ||
               parsePlayback(R"({"playing":1})", why));
  EXPECT_TRUE(parseFix(R"({"utc_s":1.79e9,"latitude_deg":-27.5,"longitude_deg":153.5})", why));
  EXPECT_FALSE(parseFix(R"({"utc_s":1.79e9,"latitude_deg":-97.5,"longitude_deg":153.5})", why));
}

// A server over a live link with a key, received from once, and a client.
class Served : public ::testing::Test {
 protected:
  static telemetry::LinkKey key() {
    std::array<std::uint8_t, telemetry::LinkKey::kBytes> secret{};
    secret.fill(7);
    return telemetry::LinkKey(secret);
  }
  void serve(const std::string& token) {
    folder_ = std::filesystem::path(::testing::TempDir()) /
              ("page" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) + token);
    std::filesystem::create_directories(folder_);
    std::ofstream(folder_ / "index.html") << "<html>page</html>";
    SampleDive dive;
    dive.duration_s = 60;
    dive.tag = telemetry::FrameTag(key());
    dive.run([&](std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
      shared_.model->accept(frame, utc_ns);
    });
    web::PageServerConfig config{.option = {}, .page = folder_, .more_scripts = {}, .token = token};
    server_ = std::make_unique<WebServer>(shared_, config);
    client_ = std::make_unique<httplib::Client>("127.0.0.1", server_->port());
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  int post(const std::string& path, const std::string& body, const httplib::Headers& headers) {
    const auto result = client_->Post(path, headers, body, "application/json");
    return result ? result->status : -1;
  }

  SharedModel shared_{telemetry::LinkIdentity{7, 42}, key(), 1};
  std::filesystem::path folder_;
  std::unique_ptr<WebServer> server_;
  std::unique_ptr<httplib::Client> client_;
};

TEST_F(Served, EveryPathAsksForTheToken) {
  serve(kToken);
  for (const char* path : {"/", "/index.html", "/api/state", "/api/map?since=0", "/api/track", "/api/history",
                           "/api/events", "/api/coverage", "/api/export/map.ply", "/api/nothing"}) {
    EXPECT_EQ(client_->Get(path)->status, 401) << path;
  }
  EXPECT_EQ(post("/api/request", R"({"kind":"pause-map"})", {{web::kPageHeader, "1"}}), 401);
  EXPECT_EQ(client_->Get("/api/state?token=wrong")->status, 401);
  const auto first = client_->Get(std::string("/?token=") + kToken);
  EXPECT_EQ(first->status, 200);
  const std::string cookie = first->get_header_value("Set-Cookie");
  EXPECT_NE(cookie.find("HttpOnly"), std::string::npos);
  EXPECT_NE(cookie.find("SameSite=Strict"), std::string::npos);
  EXPECT_EQ(client_->Get("/api/state", {{"Cookie", cookie.substr(0, cookie.find(';'))}})->status, 200);
  EXPECT_EQ(client_->Get("/api/state", {{web::kTokenHeader, kToken}})->status, 200);
}

TEST_F(Served, HostilePostsAreRefusedAndChangeNothing) {
  serve("");
  const httplib::Headers page{{web::kPageHeader, "page"}};
  const std::string good = R"({"kind":"rate","rate_bps":300})";
  EXPECT_EQ(post("/api/request", good, {}), 403);  // another site's form
  EXPECT_EQ(post("/api/request", good, {{web::kPageHeader, "1"}, {"Host", "evil.example"}}), 403);
  EXPECT_EQ(post("/api/request", "{", page), 400);
  EXPECT_EQ(post("/api/request", std::string(100'000, 'x'), page), 413);
  EXPECT_EQ(post("/api/playback", R"({"playing":false})", page), 409);  // not a recording
  EXPECT_EQ(client_->Get("/api/profile?n0=0&e0=0&n1=nan&e1=0")->status, 400);
  EXPECT_EQ(client_->Get("/api/profile?n0=1e300&e0=0&n1=0&e1=0")->status, 400);
  EXPECT_EQ(client_->Get("/../../etc/passwd")->status, 404);
  EXPECT_TRUE(shared_.model->requests().entries().empty());
  EXPECT_EQ(post("/api/request", good, page), 200);
  ASSERT_EQ(shared_.model->requests().entries().size(), 1U);
  int last = 0;
  for (int n = 0; n < 40; ++n)
    last =
        post("/api/request",
             R"({"kind":"detail","north_m":[0,1],"east_m":[0,1],"spacing_m":0.25,"max_error_m":0.05})", page);
  EXPECT_EQ(last, 503) << "more than DownlinkSender::kMaxRequests wait";
  EXPECT_LE(shared_.model->requests().entries().size(), RequestLedger::kMaxEntries);
}

TEST_F(Served, ARequestGoesFromQueuedToSentAtTheShipsTurnAndIsAnsweredByWhatItAskedFor) {
  serve("");
  EXPECT_EQ(post("/api/request", R"({"kind":"send-status"})", {{web::kPageHeader, "page"}}), 200);
  const auto state = [&] {
    return nlohmann::json::parse(client_->Get("/api/state")->body)["downlink"]["requests"][0]["state"]
        .get<std::string>();
  };
  EXPECT_EQ(state(), "queued");
  std::array<std::uint8_t, 64> payload;
  std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
  const telemetry::FrameTag tag(key());
  const telemetry::Version first = telemetry::firstVersion(SampleDive().start_utc_ns);
  const std::size_t size = telemetry::encodeStatus(SampleDive().statusAt(100), payload);
  const std::size_t length =
      telemetry::encodeFrame({{7, 42}, first + 200, telemetry::MessageType::kStatus, true},
                             std::span<const std::uint8_t>(payload).first(size), frame, tag);
  const std::int64_t now = 1'790'000'100'000'000'000;
  shared_.model->accept(std::span<const std::uint8_t>(frame).first(length), now);
  const std::size_t spoken = shared_.model->speak(now + 1000, frame);
  ASSERT_GT(spoken, 15U);
  EXPECT_EQ(state(), "sent");
  telemetry::DecodedDownlink said;
  ASSERT_TRUE(telemetry::decodeDownlink(
      telemetry::decodeFrame(std::span(frame).first(spoken)).payload.first(spoken - 15), said));
  const auto receive = [&](telemetry::Version sequence, telemetry::DownlinkCounter counter) {
    telemetry::StateReport report{.paused = true};
    report.requests[0] = {telemetry::RequestOutcome::State::kDone, said.content.request->id, counter};
    const std::size_t bytes = telemetry::encodeStateReport(report, payload);
    const std::size_t whole =
        telemetry::encodeFrame({{7, 42}, first + sequence, telemetry::MessageType::kReport, false},
                               std::span<const std::uint8_t>(payload).first(bytes), frame, tag);
    shared_.model->accept(std::span<const std::uint8_t>(frame).first(whole), now + 5'000'000'000);
  };
  receive(201, said.counter + 1);  // of another request
  EXPECT_EQ(state(), "sent");
  receive(202, said.counter);
  EXPECT_EQ(state(), "done");
  EXPECT_TRUE(nlohmann::json::parse(client_->Get("/api/state")->body)["downlink"]["paused"].get<bool>());
}

TEST_F(Served, ExportsComeWithTheirNamesAndEventsFollowChanges) {
  serve("");
  for (const char* name : {"map.ply", "elevation.tif", "colour.tif", "track.geojson"}) {
    const auto got = client_->Get(std::string("/api/export/") + name);
    EXPECT_EQ(got->status, 200) << name << got->body;
    EXPECT_NE(got->get_header_value("Content-Disposition").find(name), std::string::npos);
    EXPECT_GT(got->body.size(), 200U);
  }
  std::string received;
  client_->Get("/api/events", [&](const char* data, std::size_t length) {
    received.append(data, length);
    return received.find("\n\n") == std::string::npos;
  });
  EXPECT_EQ(received.rfind("data: {\"epoch\":\"1.0\",\"version\":", 0), 0U) << received;
}

}  // namespace
}  // namespace fathom::monitor
