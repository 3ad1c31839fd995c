// What MapCore teaches its models of light, and what a pair costs.
#include <gtest/gtest.h>
#include <random>
#include <vector>

#include "realtime/onboard/map/map_core.hpp"
#include "realtime/onboard/map/moving_map.hpp"
#include "tests/onboard/rolling_meshes.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::onboard {
namespace {

using testing::meshAt, testing::odomAt;

constexpr int kWidth = 160, kHeight = 120;

MapCoreConfig config() {
  MapCoreConfig config;
  config.rig.left = {kWidth, kHeight, 200, 200, 80, 60, 0, 0, 0, 0, 0};
  config.rig.right = config.rig.left;
  config.rig.T_right_left = SE3::fromEuler(0, 0, 0, {-0.07, 0, 0});
  config.left_format = config.right_format = PixelFormat::kMono;
  config.map.max_tiles = 64;
  config.localisation.enabled = false;
  config.lighting.grid = 16;
  return config;
}

// Pair `k` of a vehicle that moves by `step` a pair [m], 2 m up.
MapInput pairAt(int k, double step, const std::vector<std::uint16_t>& left,
                const std::vector<std::uint16_t>& right) {
  const auto view = [](const std::vector<std::uint16_t>& pixels) {
    return ImageView{pixels.data(), kWidth, kHeight, kWidth * 2, PixelFormat::kMono, 12};
  };
  return MapInput{.pair_index = static_cast<std::uint32_t>(k),
                  .utc_ns = 1'700'000'000'000'000'000 + k * std::int64_t{500'000'000},
                  .T_odom_body = SE3::fromEuler(0, 0, 0, {step * k, 0, 10}),
                  .quality = {},
                  .altitude = 2,
                  .left = view(left),
                  .right = view(right)};
}

// Images of sand, which give stereo nothing.
int imagesLearnt(int pairs, double step) {
  MapCore map(config());
  std::mt19937 random(5);
  std::vector<std::uint16_t> pixels(kWidth * kHeight);
  for (int k = 0; k < pairs; ++k) {
    for (std::uint16_t& p : pixels) p = static_cast<std::uint16_t>(1000 + random() % 64);
    static_cast<void>(map.process(pairAt(k, step, pixels, pixels)));
  }
  return map.leftLight().report().images;
}

TEST(MapLight, IsNotLearntFromAVehicleThatHovers) {
  EXPECT_LE(imagesLearnt(100, 0.0005), 2);
  EXPECT_GE(imagesLearnt(100, 0.5), 100);
}

// Both images of speckled ground, new ones with each next().
struct SpeckledPair {
  static constexpr std::size_t kSpeckle = 3;  // [px]
  std::vector<std::uint16_t> left, right, speckles;
  std::mt19937 random{6};

  // `disparity` [px]: 7 is 2 m away. `light`: of what the ground shows 2 m away.
  void next(std::size_t disparity, double light = 1) {
    left.resize(kWidth * kHeight), right.resize(left.size()), speckles.resize(left.size());
    for (std::uint16_t& s : speckles)
      s = static_cast<std::uint16_t>(light * static_cast<double>(500 + random() % 3000));
    for (std::size_t y = 0; y < kHeight; ++y)
      for (std::size_t x = 0; x < kWidth; ++x) {
        left[y * kWidth + x] = speckles[y / kSpeckle * kWidth + x / kSpeckle];
        right[y * kWidth + x] = speckles[y / kSpeckle * kWidth + (x + disparity) / kSpeckle];
      }
  }
};

// Ground 3.5 m away, when all before was 2 m away, is a tenth as bright.
TEST(MapPair, IsSeenAsWellWhereAFalseBottomTellsTheWrongRange) {
  std::vector<double> points;
  for (const double altitude : {3.5, 1.2, 0.7}) {
    MapCoreConfig with = config();
    with.lighting.choice = lighting::LightingChoice::kRangeDependent;
    MapCore map(with);
    SpeckledPair pair;
    for (int k = 0; k < 12; ++k) {
      pair.next(7);
      static_cast<void>(map.process(pairAt(k, 0.5, pair.left, pair.right)));
    }
    pair.next(4, 0.1);
    MapInput input = pairAt(12, 0.5, pair.left, pair.right);
    input.altitude = altitude;
    points.push_back(map.process(input).points);
  }
  EXPECT_GT(points[0], 100);
  EXPECT_GE(points[1], 0.9 * points[0]);
  EXPECT_GE(points[2], 0.9 * points[0]);
}

TEST(MapPair, TakesNothingFromTheHeap) {
  MapCore map(config());
  SpeckledPair pair;
  std::size_t points = 0;
  std::uint64_t heap_calls = 0;
  for (int k = 0; k < 5; ++k) {
    pair.next(7);
    MapInput input = pairAt(k, 0.2, pair.left, pair.right);
    if (k == 4) input.altitude = 1;  // a false bottom
    const test::ThreadCost before = test::threadCost();
    points = map.process(input).points;
    heap_calls = (test::threadCost() - before).heap_calls;
  }
  EXPECT_GT(points, 10u);
  EXPECT_EQ(test::sanitized() ? 0u : heap_calls, 0u);
}

TEST(MeshSlot, GivesTheMeshBackWithoutLoss) {
  const Mesh mesh = meshAt(odomAt(3), 3);
  std::vector<std::uint8_t> block(meshSlotBytes(testing::kPoints));
  const std::size_t bytes = writeMeshSlot(mesh, block);
  ASSERT_GT(bytes, 0u);
  Mesh back;
  ASSERT_TRUE(readMeshSlot({block.data(), bytes}, back));
  testing::expectEqual(mesh, back);
}

TEST(MeshSlot, RefusesWhatDoesNotFitAndWhatIsNoMesh) {
  std::vector<std::uint8_t> small(meshSlotBytes(30));
  EXPECT_EQ(writeMeshSlot(meshAt(odomAt(3), 3), small), 0u);
  Mesh mesh;
  EXPECT_FALSE(readMeshSlot(small, mesh));
  EXPECT_FALSE(readMeshSlot({}, mesh));
  std::vector<std::uint8_t> block(meshSlotBytes(testing::kPoints));
  const std::size_t bytes = writeMeshSlot(meshAt(odomAt(3), 3), block);
  EXPECT_FALSE(readMeshSlot({block.data(), bytes - 1}, mesh));
  block[0] ^= 1;
  EXPECT_FALSE(readMeshSlot(block, mesh));
  EXPECT_TRUE(mesh.vertices.empty());
}

}  // namespace
}  // namespace fathom::onboard
