#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "recon/fusion/quadtree_map.hpp"
#include "tests/support/saved_state.hpp"
#include "tests/world/ground.hpp"

namespace fathom::fusion {
namespace {

using test::rangeMesh, test::savedState;

// A loaded map equals the saved one and continues as it does.

// So small that meshes coarsen it.
QuadtreeConfig stateConfig() {
  return QuadtreeConfig{.root_size = 16, .max_level = 5, .max_tiles = 40};
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

// Order in which a full pool coarsens areas.

// Two areas of 4 x 4 m, 30 m apart, fused in turns; then new ground elsewhere until the pool is full.
class QuadtreeValue : public ::testing::Test {
 protected:
  static constexpr double kApart = 30, kElsewhere = 60;

  static QuadtreeConfig config() {
    QuadtreeConfig c{.root_size = 16};
    c.max_level = 4;  // tiles of 1 m, cells of 6.25 cm
    c.max_tiles = 52;
    c.layers_per_tile = 400;
    return c;
  }
  void fuseBoth(const std::function<double(double, double)>& first,
                const std::function<double(double, double)>& second) {
    for (unsigned k = 0; k < 40; ++k) {
      const double north = 1 + 0.5 * (k / 2 % 5), east = 1 + (k / 10);
      const bool to_second = k % 2 == 1;
      (void)map.fuse(rangeMesh({.north = north + (to_second ? kApart : 0), .east = east, .sigma = 0.002},
                               to_second ? second : first, k));
    }
  }
  void fillThePool() {
    for (unsigned k = 0; map.counters().coarsened < 5; ++k) {
      ASSERT_LT(k, 100u);
      (void)map.fuse(rangeMesh({.north = kElsewhere + k, .east = 3, .sigma = 0.002}, rough, k));
    }
  }
  // Area of the leaves that are coarser than the finest, in each of the two [m^2].
  [[nodiscard]] std::array<double, 2> coarsened() const {
    std::array<double, 2> out{};
    map.forEachLeaf([&](const TileKey& key, std::uint32_t) {
      const double size = 16.0 / (1 << key.level), north = key.north_index * size;
      if (key.level < 4 && north < kElsewhere - 10) out[north > kApart / 2 ? 1 : 0] += size * size;
    });
    return out;
  }

  static double flat(double, double) { return 10; }
  static double rough(double n, double e) { return 10 + 0.15 * std::sin(9 * n) * std::cos(8 * e); }

  QuadtreeMap map{config()};
};

TEST_F(QuadtreeValue, FlatGroundIsCoarsenedBeforeRelief) {
  fuseBoth(rough, flat);
  fillThePool();
  EXPECT_EQ(coarsened()[0], 0);
  EXPECT_GE(coarsened()[1], 8);
}

TEST_F(QuadtreeValue, GroundFarFromTheVehicleIsCoarsenedFirst) {
  fuseBoth(rough, rough);
  map.noteVehicle({kApart, 0});
  fillThePool();
  EXPECT_GE(coarsened()[0], 8);
  EXPECT_EQ(coarsened()[1], 0);
}

TEST_F(QuadtreeValue, SentGroundIsCoarsenedFirstUntilItChanges) {
  fuseBoth(rough, rough);
  for (int e = -1; e <= 1; ++e)
    for (int n = -1; n <= 1; ++n) map.noteSent({n, e, 2});
  fillThePool();
  EXPECT_GE(coarsened()[0], 8);
  EXPECT_EQ(coarsened()[1], 0);

  map.clear();
  fuseBoth(rough, rough);
  for (int e = -1; e <= 1; ++e)
    for (int n = -1; n <= 1; ++n) map.noteSent({n, e, 2});
  for (int e = -1; e <= 1; ++e)
    for (int n = 6; n <= 9; ++n) map.noteSent({n, e, 2});
  fuseBoth(rough, [](double, double) { return 10.02; });  // the first was sent, then observed again: not sent
  for (int e = -1; e <= 1; ++e)
    for (int n = 6; n <= 9; ++n) map.noteSent({n, e, 2});
  fillThePool();
  EXPECT_EQ(coarsened()[0], 0);
  EXPECT_GE(coarsened()[1], 8);
}

TEST_F(QuadtreeValue, MappingContinuesCorrectlyWhileThePoolCoarsens) {
  fuseBoth(rough, flat);
  fillThePool();
  std::size_t cells = map.fuse(rangeMesh({.north = kElsewhere + 50, .east = 3, .sigma = 0.002}, flat, 7));
  EXPECT_GT(cells, 900u);
  EXPECT_EQ(map.counters().refused, 0u);
  for (const auto& v : toMesh(map).vertices) {
    const double n = v.x(), e = v.y();
    const bool is_flat = (n > kApart / 2 && n < kElsewhere - 10) || n > kElsewhere + 45;
    EXPECT_NEAR(v.z(), is_flat ? flat(n, e) : rough(n, e), is_flat ? 0.01 : 0.12);
  }
}

}  // namespace
}  // namespace fathom::fusion
