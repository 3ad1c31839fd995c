#include "realtime/onboard/link/link_core.hpp"

#include <gtest/gtest.h>

#include <array>

#include "realtime/kernel/frame_port.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

fusion::QuadtreeConfig mapConfig() {
  fusion::QuadtreeConfig config;
  config.root_size = 32;
  config.max_level = 5;
  config.max_tiles = 256;
  return config;
}

LinkCoreConfig linkConfig() {
  LinkCoreConfig config;
  config.scheduler.identity = {1, 2};
  config.tile_level = 3;
  return config;
}

// A flat patch of seafloor at 12 m depth with points every 10 cm.
Mesh patch(float north, float east, float size) {
  Mesh mesh;
  const int n = static_cast<int>(size / 0.1F) + 1;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) mesh.vertices.emplace_back(north + 0.1F * i, east + 0.1F * j, 12.0F);
  mesh.sigma.assign(mesh.vertices.size(), 0.01F);
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(i * n + j); };
  for (int i = 0; i + 1 < n; ++i)
    for (int j = 0; j + 1 < n; ++j) {
      mesh.triangles.push_back({at(i, j), at(i, j + 1), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i + 1, j)});
    }
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

TEST(LinkCore, OffersATileOnlyWhenTheVehicleHasLeftIt) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCore link(linkConfig());
  link.noteMapped(mapped(map, 10 * kSecond, 0.5F, 0.5F, 2.0F), 32);
  link.offerTiles(map, 11 * kSecond);
  EXPECT_EQ(link.counters().tiles_offered, 0u);
  EXPECT_FALSE(link.drained());
  link.offerTiles(map, 15 * kSecond);
  EXPECT_EQ(link.counters().tiles_offered, 1u);
  EXPECT_NEAR(link.mappedArea(), 4.0, 0.8);
}

TEST(LinkCore, ATileThatNeverSettlesIsOfferedAfterTheLongestWait) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCore link(linkConfig());
  for (int second = 0; second <= 31; ++second) {
    link.noteMapped(mapped(map, second * kSecond, 0.5F, 0.5F, 2.0F), 32);
    link.offerTiles(map, second * kSecond);
  }
  EXPECT_EQ(link.counters().tiles_offered, 1u);
}

TEST(LinkCore, EverythingGoesOutWhenTheSurveyIsOverAndThenItIsDrained) {
  fusion::QuadtreeMap map(mapConfig());
  LinkCore link(linkConfig());
  link.noteMapped(mapped(map, 0, 1.0F, 1.0F, 6.0F), 32);  // touches four squares of 4 m
  link.offerTiles(map, 0, true);
  EXPECT_EQ(link.counters().tiles_offered, 4u);
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer;
  std::size_t bytes = 0;
  std::int64_t now = 0;
  for (; now < 3600 * kSecond && !link.drained(); now += kSecond)
    while (const std::size_t size = link.nextFrame(now, buffer)) bytes += size;
  EXPECT_TRUE(link.drained());
  // The rate holds: 300 bit/s, and two frames of burst.
  EXPECT_LE(static_cast<double>(bytes), 300.0 / 8 * static_cast<double>(now / kSecond) + 2 * 128 + 1);
}

TEST(LinkCore, APairThatGaveNothingChangesNothing) {
  LinkCore link(linkConfig());
  link.noteMapped(MapOutput{}, 32);
  EXPECT_TRUE(link.drained());
}

TEST(LinkCore, RefusesAConfigurationThatCannotBe) {
  LinkCoreConfig config = linkConfig();
  config.max_wait_s = config.settle_s - 1;
  EXPECT_THROW(LinkCore{config}, std::invalid_argument);
}

}  // namespace
}  // namespace fathom::onboard
