// Order in which a full pool coarsens areas.
#include <gtest/gtest.h>

#include <cmath>

#include "recon/fusion/quadtree_map.hpp"
#include "tests/fusion/synthetic_footprint.hpp"

namespace fathom::fusion {
namespace {

using test::rangeMesh;

// Two areas of 4 x 4 m, 30 m apart, fused in turns; then new ground elsewhere until the pool is full.
class QuadtreeValue : public ::testing::Test {
 protected:
  static constexpr double kApart = 30, kElsewhere = 60;

  static QuadtreeConfig config() {
    QuadtreeConfig c;
    c.root_size = 16;
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
