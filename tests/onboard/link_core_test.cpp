#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

#include "realtime/base/units.hpp"
#include "realtime/kernel/frame_port.hpp"
#include "realtime/onboard/link/link_core.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/ship/link_receiver.hpp"
#include "tests/support/lattice_mesh.hpp"

namespace fathom::onboard {
namespace {

fusion::QuadtreeConfig mapConfig() {
  return fusion::QuadtreeConfig{.root_size = 32, .max_level = 5, .max_tiles = 256};
}

LinkCoreConfig linkConfig() {
  LinkCoreConfig config;
  config.scheduler.identity = {1, 2};
  config.root_size = 32;
  config.max_level = 5;
  return config;
}

// The detail of a place [m] that touches four squares of 2 m.
telemetry::Request detailRequest() {
  telemetry::Request request{.kind = telemetry::Request::Kind::kDetail};
  request.north_min = request.east_min = 2.1;
  request.north_max = request.east_max = 4.9;
  request.spacing = 0.125;
  return request;
}

// A flat patch of seafloor at 12 m depth with points every 10 cm.
Mesh patch(float north, float east, float size) {
  Mesh mesh;
  const int n = static_cast<int>(size / 0.1F) + 1;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) mesh.vertices.emplace_back(north + 0.1F * i, east + 0.1F * j, 12.0F);
  mesh.sigma.assign(mesh.vertices.size(), 0.01F);
  mesh.triangles = test::latticeTriangles(n, n);
  return mesh;
}

MapOutput mapped(fusion::QuadtreeMap& map, std::int64_t utc_ns, float north, float east, float size) {
  MapOutput output;
  output.utc_ns = utc_ns;
  output.nodes_updated = map.fuse(patch(north, east, size));
  output.min_north_east = {north, east};
  output.max_north_east = {north + size, east + size};
  return output;
}

TEST(LinkCore, LooksAtASquareInViewNoMoreThanOnceASecond) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCore link(linkConfig());
  for (int tenth = 0; tenth <= 30; ++tenth) {
    const float reach = 1.0F + 0.1F * static_cast<float>(tenth);
    link.noteMapped(mapped(map, tenth * kSecond_ns / 10, 0.5F, 0.5F, reach));
    link.offerTiles(map, tenth * kSecond_ns / 10);
    const double known = link.mappedArea(), now = reach * reach;
    EXPECT_LE(known, now + 0.8);
    const double second_ago = std::max(0.0F, reach - 1.1F) * std::max(0.0F, reach - 1.1F);
    EXPECT_GE(known, second_ago - 0.8);
  }
}

TEST(LinkCore, EverythingGoesOutWhenTheSurveyIsOverAndThenItIsDrained) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCore link(linkConfig());
  link.noteMapped(mapped(map, 0, 1.0F, 1.0F, 6.0F));  // touches four squares of 4 m
  EXPECT_FALSE(link.drained());
  link.offerTiles(map, 0, true);
  EXPECT_EQ(link.counters().squares_held, 5);  // and a coarse one
  EXPECT_GT(link.counters().blocks_waiting, 35);
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
  std::size_t bytes = 0;
  std::int64_t now = 0;
  for (; now < 3600 * kSecond_ns && !link.drained(); now += kSecond_ns)
    while (const std::size_t size = link.nextFrame(now, buffer)) bytes += size;
  EXPECT_TRUE(link.drained());
  EXPECT_LT(now, 120 * kSecond_ns);
  // The rate holds: 300 bit/s, and two frames of burst.
  EXPECT_LE(static_cast<double>(bytes), 300.0 / 8 * static_cast<double>(now / kSecond_ns) + 2 * 128 + 1);
}

TEST(LinkCore, TellsWhichSquaresTheShipHoldsWholeOnceItSaysSo) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCore link(linkConfig());
  link.noteMapped(mapped(map, 0, 1.0F, 1.0F, 6.0F));
  link.offerTiles(map, 0, true);
  telemetry::LinkReceiver ship;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
  std::set<std::pair<int, int>> whole;
  for (std::int64_t now = 0; now < 120 * kSecond_ns; now += kSecond_ns) {
    while (const std::size_t size = link.nextFrame(now, buffer))
      ship.accept(std::span(buffer).first(size), [](const auto&) { return true; });
    if (now < 60 * kSecond_ns) continue;  // until then nobody has said anything
    link.acknowledge(ship.acknowledgement(), now, [&](const fusion::TileKey& key) {
      EXPECT_EQ(key.level, 3);
      whole.insert({key.north_index, key.east_index});
    });
  }
  EXPECT_EQ(whole, (std::set<std::pair<int, int>>{{0, 0}, {0, 1}, {1, 0}, {1, 1}}));
}

TEST(LinkCore, ServesARequestForDetailAtItsSpacingAndNoFurtherThanItsCap) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCoreConfig config = linkConfig();
  config.max_detail_squares = 3;
  LinkCore link(config);
  mapped(map, 0, 1.0F, 1.0F, 6.0F);  // on the map, and not offered
  telemetry::Request request = detailRequest();
  request.max_error = 0.02;
  link.request(request, 0, 0);
  EXPECT_FALSE(link.drained());
  link.offerTiles(map, 0);
  EXPECT_EQ(link.counters().squares_held, 3);  // of the four squares of 2 m
  EXPECT_EQ(link.detailLeftOut(), 1U);
}

TEST(LinkCore, GroundThatTheMapHasLeftIsWithdrawnWithTheDetailThatWasAskedForAndItsAreaWithIt) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCore link(linkConfig());
  link.noteMapped(mapped(map, 0, 1.0F, 1.0F, 6.0F));
  link.request(detailRequest(), 0, 0);
  link.offerTiles(map, 0, true);
  ASSERT_GT(link.mappedArea(), 30);
  telemetry::LinkReceiver ship;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
  telemetry::MapPacketDecoder decoder;
  telemetry::DecodedMapPacket packet;
  std::map<telemetry::BlockKey, std::uint16_t> shown;
  std::int64_t now = 0;
  const auto converse = [&] {
    for (const std::int64_t end = now + 300 * kSecond_ns; now < end; now += kSecond_ns) {
      while (const std::size_t size = link.nextFrame(now, buffer))
        ship.accept(std::span(buffer).first(size), [&](const telemetry::LinkReceiver::Message& m) {
          if (m.type == telemetry::MessageType::kMapPacket && decoder.decode(m.payload, packet))
            for (const telemetry::MapBlock& b : packet.blocks) shown[b.key] = b.seen;
          return true;
        });
      if (ship.turn()) link.acknowledge(ship.acknowledgement(), now);
    }
  };
  const auto anything = [&] {
    return std::any_of(shown.begin(), shown.end(), [](const auto& block) { return block.second != 0; });
  };
  converse();
  ASSERT_TRUE(anything());
  const auto detail = *telemetry::spacingCode(0.125);
  ASSERT_TRUE(std::any_of(shown.begin(), shown.end(),
                          [&](const auto& block) { return block.first.spacing == detail; }));
  const fusion::QuadtreeMap elsewhere(mapConfig());
  link.noteChanged({1, 1}, {7, 7});
  link.offerTiles(elsewhere, now, true);
  EXPECT_FALSE(link.drained());
  EXPECT_EQ(link.mappedArea(), 0);
  converse();
  EXPECT_FALSE(anything());
  EXPECT_TRUE(link.drained());
}

TEST(LinkCore, APairThatGaveNothingChangesNothing) {
  LinkCore link(linkConfig());
  link.noteMapped(MapOutput{});
  EXPECT_TRUE(link.drained());
}

TEST(LinkCore, RefusesASpacingThatTheMapDoesNotHave) {
  LinkCoreConfig config = linkConfig();
  config.scheduler.blocks.spacing = 0.3;
  config.scheduler.blocks.coarse_spacing = 0.3;
  EXPECT_THROW(LinkCore{config}, std::invalid_argument);
  config.scheduler.blocks.spacing = config.scheduler.blocks.coarse_spacing = 1.0 / 64;  // finer than the map
  EXPECT_THROW(LinkCore{config}, std::invalid_argument);
}

// Two 20 m lines 2 m apart: 42 m in all.
const std::vector<Eigen::Vector2d> kLawnmower = {{0, 0}, {20, 0}, {20, 2}, {0, 2}};

TEST(MissionProgress, NeedsAPlan) {
  MissionProgress progress({});
  progress.update({3, 4});
  EXPECT_FALSE(progress.fraction().has_value());
}

TEST(MissionProgress, FollowsALawnmowerToItsEnd) {
  MissionProgress progress(kLawnmower, 0.5);
  for (double n = 0; n <= 20; n += 0.25) progress.update({n, 0.1});
  EXPECT_NEAR(*progress.fraction(), 20.0 / 42, 0.03);
  for (double e = 0; e <= 2; e += 0.25) progress.update({20, e});
  for (double n = 20; n >= 0; n -= 0.25) progress.update({n, 2.1});
  EXPECT_NEAR(*progress.fraction(), 1.0, 1e-9);
}

TEST(MissionProgress, DoesNotJumpToTheNeighbouringLine) {
  MissionProgress progress(kLawnmower, 0.5);
  for (double n = 0; n <= 10; n += 0.25)
    progress.update({n, 1.9});  // far off the first line, on the last one
  EXPECT_NEAR(*progress.fraction(), 10.0 / 42, 0.01);
}

TEST(MissionProgress, NeverRunsBackwards) {
  MissionProgress progress(kLawnmower, 0.5);
  progress.update({10, 0});
  const double before = *progress.fraction();
  progress.update({2, 0});
  EXPECT_EQ(*progress.fraction(), before);
}

TEST(MissionProgress, ACornerCutByTheTurnIsStillPassed) {
  MissionProgress progress({{0, 0}, {50, 0}, {50, 50}}, 1.0);
  for (double n = 0; n <= 45; n += 0.5) progress.update({n, 0});
  for (double a = 0; a <= 6; a += 0.25) progress.update({45 + 0.8 * a, a});
  for (double e = 6; e <= 25; e += 0.5) progress.update({49.8, e});
  EXPECT_NEAR(*progress.fraction(), 0.75, 0.02);
}

}  // namespace
}  // namespace fathom::onboard
