// What MapCore teaches its models of light, and what a pair costs.
#include <gtest/gtest.h>

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

TEST(MapPair, TakesNothingFromTheHeap) {
  constexpr int kSpeckle = 3, kDisparity = 7;  // [px]; what the rig sees 2 m away
  MapCore map(config());
  std::mt19937 random(6);
  std::vector<std::uint16_t> left(kWidth * kHeight), right(left.size());
  std::vector<std::uint16_t> speckles(left.size());
  std::size_t points = 0;
  std::uint64_t heap_calls = 0;
  for (int k = 0; k < 5; ++k) {
    for (std::uint16_t& s : speckles) s = static_cast<std::uint16_t>(500 + random() % 3000);
    for (std::size_t y = 0; y < kHeight; ++y)
      for (std::size_t x = 0; x < kWidth; ++x) {
        left[y * kWidth + x] = speckles[y / kSpeckle * kWidth + x / kSpeckle];
        right[y * kWidth + x] = speckles[y / kSpeckle * kWidth + (x + kDisparity) / kSpeckle];
      }
    const MapInput input = pairAt(k, 0.2, left, right);
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
