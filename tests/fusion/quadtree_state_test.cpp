// A loaded map equals the saved one and continues as it does.
#include <gtest/gtest.h>

#include <random>

#include "recon/fusion/quadtree_map.hpp"
#include "tests/fusion/synthetic_footprint.hpp"
#include "tests/support/saved_state.hpp"

namespace fathom::fusion {
namespace {

using test::rangeMesh;
using test::savedState;

// So small that meshes coarsen it.
QuadtreeConfig stateConfig() {
  QuadtreeConfig c;
  c.root_size = 16;
  c.max_level = 5;
  c.max_tiles = 40;
  return c;
}

Mesh meshOf(int k) {
  std::mt19937 random(static_cast<unsigned>(k));
  std::uniform_real_distribution<double> place(-4, 4);
  return rangeMesh({.north = place(random),
                    .east = place(random),
                    .length = 1.5,
                    .width = 1.2,
                    .spacing = k % 3 == 0 ? 0.2 : 0.08,
                    .sigma = k % 4 == 0 ? 0.05 : 0.01,
                    .colour = {static_cast<std::uint8_t>(3 * k), 120, 200}},
                   test::reef, static_cast<unsigned>(k));
}

// Adds meshes, removes some, moves the vehicle, marks squares as sent.
void live(QuadtreeMap& map, int from, int to) {
  for (int k = from; k < to; ++k) {
    map.noteVehicle({0.1 * k, -0.1 * k});
    (void)map.fuse(meshOf(k));
    if (k % 3 == 2) (void)map.remove(meshOf(k - 1));
    if (k % 5 == 0) map.noteSent({0, 0, 0});
  }
}

bool load(QuadtreeMap& map, std::span<const std::uint8_t> bytes) {
  rt::StateReader reader(bytes);
  return map.load(reader);
}

TEST(QuadtreeState, ALoadedMapContinuesAsTheSavedOne) {
  QuadtreeMap whole(stateConfig());
  live(whole, 0, 60);
  ASSERT_GT(whole.counters().coarsened, 0u);
  const std::vector<std::uint8_t> state = savedState(whole);
  QuadtreeMap loaded(stateConfig());
  live(loaded, 100, 120);  // forgotten
  ASSERT_TRUE(load(loaded, state));
  EXPECT_EQ(loaded.canonicalBytes(), whole.canonicalBytes());
  EXPECT_EQ(savedState(loaded), state);
  for (QuadtreeMap* map : {&whole, &loaded}) live(*map, 60, 120);
  EXPECT_EQ(loaded.canonicalBytes(), whole.canonicalBytes());
  EXPECT_EQ(savedState(loaded), savedState(whole));
}

// Of the 48 bytes that a layer takes in memory; a cell takes one, a tile some 70.
TEST(QuadtreeState, ASavedLayerTakesHalfOfItsBytes) {
  QuadtreeMap map(stateConfig());
  live(map, 0, 60);
  const QuadtreeMap::Counters c = map.counters();
  constexpr std::size_t kOfTile = 256 + 70, kOfLayer = 28, kFixed = 2000;
  EXPECT_LT(savedState(map).size(), static_cast<std::size_t>(c.tiles_high_water) * kOfTile +
                                        static_cast<std::size_t>(c.layers_used) * kOfLayer + kFixed);
}

TEST(QuadtreeState, AnEmptyMapIsSavedAndLoaded) {
  const QuadtreeMap empty(stateConfig());
  QuadtreeMap loaded(stateConfig());
  live(loaded, 0, 20);
  ASSERT_TRUE(load(loaded, savedState(empty)));
  EXPECT_EQ(loaded.canonicalBytes(), "");
  live(loaded, 0, 20);
  EXPECT_NE(loaded.canonicalBytes(), "");
}

TEST(QuadtreeState, AMapOfAnotherSizeIsRefused) {
  QuadtreeMap whole(stateConfig());
  live(whole, 0, 60);
  QuadtreeConfig smaller = stateConfig();
  smaller.max_tiles = 20;
  QuadtreeMap loaded(smaller);
  EXPECT_FALSE(load(loaded, savedState(whole)));
  EXPECT_EQ(loaded.canonicalBytes(), "");
}

TEST(QuadtreeState, DamageIsRefusedOrDoesNoHarm) {
  QuadtreeMap whole(stateConfig());
  live(whole, 0, 30);
  const std::vector<std::uint8_t> state = savedState(whole);
  QuadtreeMap other(stateConfig());
  test::eachRefused(state, 50, [&](auto bytes) { return load(other, bytes); });
  EXPECT_EQ(other.canonicalBytes(), "");
  int refused = 0, loads = 0;
  test::eachDamage(state, 80, [&](auto bytes) {
    ++loads;
    refused += load(other, bytes) ? 0 : 1;
    live(other, 30, 32);
    (void)toMesh(other);
  });
  EXPECT_GT(refused, 0);
  EXPECT_LT(refused, loads);
}

}  // namespace
}  // namespace fathom::fusion
