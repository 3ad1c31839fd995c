#include "telemetry/monitor/monitor_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <random>

#include "telemetry/monitor/reports.hpp"
#include "tests/monitor/sample_dive.hpp"

namespace fathom::monitor {
namespace {

using Frame = std::vector<std::uint8_t>;

std::vector<std::pair<std::int64_t, Frame>> framesOf(const SampleDive& dive) {
  std::vector<std::pair<std::int64_t, Frame>> frames;
  dive.run([&](std::int64_t utc_ns, std::span<const std::uint8_t> bytes) {
    frames.emplace_back(utc_ns, Frame(bytes.begin(), bytes.end()));
  });
  return frames;
}

// Everything that is shown of a model, as one string.
std::string shown(const MonitorModel& model) {
  std::string all = trackJson(model) + trackGeoJson(model);
  for (const auto& [key, tile] : model.map().tiles())
    for (const auto& node : tile.content.tile.nodes)
      all += std::to_string(node.coverage > 0 ? node.depth : -1) + std::to_string(node.colour[0]);
  const auto state = nlohmann::json::parse(stateJson(model, {}));
  return all + state["status"].dump() + state["mission"].dump() + state["map"].dump();
}

TEST(MonitorModel, RebuildsTheMapAsItWasOnBoardFromALosslessLink) {
  SampleDive dive;
  dive.duration_s = 400;
  dive.rate_bps = 2000;
  dive.loss = 0;
  dive.colour_bits = 0;
  MonitorModel model;
  for (const auto& [utc_ns, bytes] : framesOf(dive)) model.accept(bytes, utc_ns);
  int compared = 0;
  for (int index = 0; index < 40; ++index) {
    const HeightTile tile = SampleDive::tileOf(index);
    const auto found = model.map().tiles().find({tile.level, tile.north_index, tile.east_index});
    ASSERT_NE(found, model.map().tiles().end()) << index;
    const auto& got = found->second.content;
    for (int i = 0; i < HeightTile::kSide; i += got.stride) {
      for (int j = 0; j < HeightTile::kSide; j += got.stride) {
        ASSERT_NEAR(got.tile.at(i, j).depth, tile.at(i, j).depth, 0.0101);
        ++compared;
      }
    }
  }
  EXPECT_GT(compared, 40 * 81);
  EXPECT_NEAR(model.map().area(), static_cast<double>(model.map().size()) * 16, 1e-6);
  EXPECT_EQ(model.mission()->vehicle_name, "sirius");
  EXPECT_EQ(model.receiver().counters().lost, 0U);
}

TEST(MonitorModel, DuplicateReorderedGarbageAndForeignFramesChangeNothingThatIsShown) {
  SampleDive dive, other;
  dive.duration_s = other.duration_s = 600;
  other.identity.dive_id = 43;
  const auto frames = framesOf(dive);
  const auto foreign = framesOf(other);
  MonitorModel clean(dive.identity), dirty(dive.identity);
  for (const auto& [utc_ns, bytes] : frames) clean.accept(bytes, utc_ns);

  std::mt19937 random(5);
  auto disturbed = frames;
  for (std::size_t i = 0; i + 4 < disturbed.size(); i += 4)  // out of order within four frames
    std::shuffle(disturbed.begin() + static_cast<std::ptrdiff_t>(i),
                 disturbed.begin() + static_cast<std::ptrdiff_t>(i + 4), random);
  for (std::size_t i = 0; i < disturbed.size(); ++i) {
    const auto& [utc_ns, bytes] = disturbed[i];
    Frame garbage(random() % 300);
    for (auto& byte : garbage) byte = static_cast<std::uint8_t>(random());
    dirty.accept(garbage, utc_ns);
    if (i < foreign.size()) dirty.accept(foreign[i].second, utc_ns);
    Frame damaged = bytes;
    damaged[random() % damaged.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    dirty.accept(damaged, utc_ns);
    dirty.accept(bytes, utc_ns);
    dirty.accept(bytes, utc_ns);
  }
  EXPECT_EQ(shown(dirty), shown(clean));
  const auto& c = dirty.receiver().counters();
  EXPECT_EQ(c[telemetry::FrameVerdict::kAccepted], frames.size());
  EXPECT_EQ(c[telemetry::FrameVerdict::kDuplicate], frames.size());
  EXPECT_EQ(c[telemetry::FrameVerdict::kForeign], std::min(frames.size(), foreign.size()));
}

TEST(MonitorModel, LateStatusDoesNotTakeTheVehicleBack) {
  SampleDive dive;
  const auto send = [&](MonitorModel& model, double t, std::uint16_t sequence) {
    Frame payload(64), frame(telemetry::kMaxFrameBytes);
    payload.resize(telemetry::encodeStatus(dive.statusAt(t), payload));
    frame.resize(
        telemetry::encodeFrame({dive.identity, sequence, telemetry::MessageType::kStatus}, payload, frame));
    model.accept(frame, 0);
  };
  MonitorModel model;
  send(model, 100, 2);
  send(model, 50, 1);
  EXPECT_EQ(model.status()->utc_ns, dive.statusAt(100).utc_ns);
  EXPECT_EQ(model.track().size(), 2U);
}

TEST(MonitorModel, AnInvalidMessageInAWholeFrameIsCountedAndChangesNothing) {
  MonitorModel model;
  Frame frame(64);
  const Frame payload(11, 0xFF);
  std::uint16_t sequence = 0;
  for (std::uint8_t type = 1; type <= 7; ++type) {
    Frame bytes(64);
    bytes.resize(telemetry::encodeFrame({{7, 42}, sequence++, static_cast<telemetry::MessageType>(type)},
                                        payload, bytes));
    const auto verdict = model.accept(bytes, 0).verdict;
    if (static_cast<telemetry::MessageType>(type) == telemetry::MessageType::kDownlink)
      EXPECT_EQ(verdict, telemetry::FrameVerdict::kType);
    else
      EXPECT_EQ(verdict, telemetry::FrameVerdict::kBadPayload) << unsigned{type};
  }
  EXPECT_FALSE(model.status() || model.mission());
  EXPECT_TRUE(model.track().empty() && model.map().size() == 0);
}

telemetry::DecodedTile decoded(const HeightTile& tile, int stride) {
  Frame bytes(telemetry::kMaxTileBytes);
  bytes.resize(telemetry::encodeTile(tile, stride, {}, bytes));
  telemetry::DecodedTile out;
  out.tile.north_index = tile.north_index;
  out.tile.east_index = tile.east_index;
  out.tile.level = tile.level;
  out.tile.revision = tile.revision;
  EXPECT_TRUE(telemetry::decodeTile(bytes, out));
  return out;
}

TEST(TileStore, TheNewerRevisionWinsAndOfOneRevisionTheFinerLattice) {
  TileStore store;
  const HeightTile first = telemetry::sampleTile(0, 0, 4, 1, 1, 5),
                   second = telemetry::sampleTile(0, 0, 4, 1, 2, 6);
  EXPECT_TRUE(store.put(decoded(first, 4), 0));
  EXPECT_TRUE(store.put(decoded(first, 1), 0));
  EXPECT_FALSE(store.put(decoded(first, 4), 0));
  EXPECT_TRUE(store.put(decoded(second, 1), 0));
  EXPECT_FALSE(store.put(decoded(first, 1), 0));
  EXPECT_EQ(store.size(), 1U);
}

TEST(TileStore, WhereAFinerTileShowsTheSeafloorTheCoarserOneGivesWay) {
  TileStore store;
  HeightTile parent = telemetry::sampleTile(0, 0, 8);
  parent.level = 2;
  store.put(decoded(parent, 1), 0);
  EXPECT_NEAR(store.area(), 64, 1e-9);
  const std::uint64_t before = store.version();
  store.put(decoded(telemetry::sampleTile(1, 1, 4), 1), 0);  // a quarter of it
  EXPECT_GT(store.tiles().begin()->second.version, before);  // the coarser one is to be shown anew
  const HeightTile shown = store.shown(store.tiles().begin()->second);
  EXPECT_EQ(shown.at(12, 12).coverage, 0);
  EXPECT_GT(shown.at(4, 12).coverage, 0);
  EXPECT_GT(shown.at(8, 12).coverage, 0);  // on the border
  EXPECT_NEAR(store.area(), 64, 1.0);      // no more than a cell is shown twice
}

TEST(TileStore, RefusesWhatItHasNoRoomForAndCountsIt) {
  TileStore store(3);
  for (int n = 0; n < 5; ++n) store.put(decoded(telemetry::sampleTile(n, 0), 8), 0);
  EXPECT_EQ(store.size(), 3U);
  EXPECT_EQ(store.refused(), 2U);
  EXPECT_TRUE(
      store.put(decoded(telemetry::sampleTile(0, 0), 4), 0));  // a better one of a held tile still enters
}

TEST(TileStore, ItsMeshHasEveryTriangleOnceAndFacesUp) {
  TileStore store;
  for (int n = 0; n < 3; ++n) store.put(decoded(telemetry::sampleTile(n, 0), 2), 0);
  const Mesh mesh = store.mesh();
  EXPECT_EQ(mesh.triangles.size(), 3U * 2 * 64);
  for (const auto& normal : mesh.normals) EXPECT_LT(normal.z(), 0);
  EXPECT_EQ(mesh.colours.size(), mesh.vertices.size());
}

TEST(Reports, StateIsJsonBeforeAnythingArrivedAndTilesComeOnlyOnce) {
  MonitorModel model;
  const auto empty = nlohmann::json::parse(stateJson(model, {}));
  EXPECT_TRUE(empty["status"].is_null() && empty["identity"].is_null() && empty["link"]["age_s"].is_null());
  EXPECT_EQ(trackGeoJson(model), "");
  SampleDive dive;
  dive.duration_s = 300;
  for (const auto& [utc_ns, bytes] : framesOf(dive)) model.accept(bytes, utc_ns);
  EXPECT_GT(tilesBinary(model, 0).size(), 1000U);
  EXPECT_EQ(tilesBinary(model, model.map().version()).size(), 12U);
  const auto geo = nlohmann::json::parse(trackGeoJson(model));
  EXPECT_EQ(geo["features"].size(), 2U);
  EXPECT_NEAR(geo["features"][1]["geometry"]["coordinates"][0].get<double>(), 2.65 * 180 / 3.14159265358979,
              1e-3);
}

}  // namespace
}  // namespace fathom::monitor
