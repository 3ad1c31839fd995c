#include "realtime/onboard/map/moving_map.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "realtime/onboard/map/mesh_slot.hpp"
#include "tests/onboard/made_dive.hpp"

namespace fathom::onboard {
namespace {

using testing::MemorySlots;

constexpr std::size_t kPoints = 400;

// What a camera 2 m over rolling ground gives: dense in every third mesh, sparse in every fifth, so that the
// quadtree makes large tiles and splits them.
Mesh meshAt(const SE3& T_nav_cam, int number) {
  const int side = number % 5 == 0 ? 6 : number % 3 == 0 ? 20 : 14;
  std::mt19937 random(static_cast<std::uint32_t>(number));
  std::uniform_real_distribution<float> jitter(-0.02F, 0.02F);
  Mesh mesh;
  for (int i = 0; i < side; ++i)
    for (int j = 0; j < side; ++j) {
      const float x = 1.4F * (static_cast<float>(i) / static_cast<float>(side - 1) - 0.5F) + jitter(random);
      const float y = 1.1F * (static_cast<float>(j) / static_cast<float>(side - 1) - 0.5F) + jitter(random);
      const Eigen::Vector3d p = T_nav_cam * Eigen::Vector3d(x, y, 2);
      mesh.vertices.emplace_back(x, y,
                                 2.0F + 0.1F * static_cast<float>(std::sin(3 * p.x()) * std::cos(2 * p.y())));
      mesh.sigma.push_back(0.01F);
      mesh.colours.push_back({static_cast<std::uint8_t>(100 + i), static_cast<std::uint8_t>(90 + j), 80});
    }
  for (int i = 0; i + 1 < side; ++i)
    for (int j = 0; j + 1 < side; ++j) {
      const auto a = static_cast<std::uint32_t>(i * side + j), b = a + static_cast<std::uint32_t>(side);
      mesh.triangles.push_back({a, b, a + 1});
      mesh.triangles.push_back({b, b + 1, a + 1});
    }
  return mesh;
}

SE3 odomAt(int number) {
  return SE3::fromEuler(0.02 * std::sin(number), 0.01, 0.1 * number,
                        {0.25 * (number % 20), 0.8 * (number / 20), 10});
}

// Keyframes are every fourth mesh; they have drifted by more the later they came.
SE3 correction(int keyframe, double much) {
  return SE3::fromEuler(0, 0, 0.01 * much * keyframe,
                        {0.03 * much * keyframe, -0.02 * much * keyframe, 0.01});
}

fusion::QuadtreeConfig mapConfig() {
  fusion::QuadtreeConfig config;
  config.root_size = 8;
  config.max_level = 3;
  config.max_tiles = 512;
  return config;
}

void expectEqual(const Mesh& a, const Mesh& b) {
  ASSERT_EQ(a.vertices.size(), b.vertices.size());
  ASSERT_EQ(a.triangles, b.triangles);
  ASSERT_EQ(a.colours, b.colours);
  ASSERT_EQ(a.sigma, b.sigma);
  for (std::size_t i = 0; i < a.vertices.size(); ++i) ASSERT_EQ(a.vertices[i], b.vertices[i]);
}

TEST(MeshSlot, GivesTheMeshBackWithoutLoss) {
  const Mesh mesh = meshAt(odomAt(3), 3);
  std::vector<std::uint8_t> block(meshSlotBytes(kPoints));
  const std::size_t bytes = writeMeshSlot(mesh, block);
  ASSERT_GT(bytes, 0u);
  Mesh back;
  ASSERT_TRUE(readMeshSlot({block.data(), bytes}, back));
  expectEqual(mesh, back);
}

TEST(MeshSlot, RefusesWhatDoesNotFitAndWhatIsNoMesh) {
  std::vector<std::uint8_t> small(meshSlotBytes(30));
  EXPECT_EQ(writeMeshSlot(meshAt(odomAt(3), 3), small), 0u);
  Mesh mesh;
  EXPECT_FALSE(readMeshSlot(small, mesh));
  EXPECT_FALSE(readMeshSlot({}, mesh));
  std::vector<std::uint8_t> block(meshSlotBytes(kPoints));
  const std::size_t bytes = writeMeshSlot(meshAt(odomAt(3), 3), block);
  EXPECT_FALSE(readMeshSlot({block.data(), bytes - 1}, mesh));
  block[0] ^= 1;
  EXPECT_FALSE(readMeshSlot(block, mesh));
  EXPECT_TRUE(mesh.vertices.empty());
}

TEST(MovingMap, AfterKeyframesMovedItIsTheMapFusedAfreshFromTheFinalPoses) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints);
  double much = 0;
  const MovingMap::PoseOf pose_of = [&](int k, const SE3& T) { return correction(k, much) * T; };
  int moved_tiles = 0;
  const MovingMap::OnMoved on_moved = [&](const auto&, const auto&) { ++moved_tiles; };
  for (int number = 0; number < 60; ++number) {
    if (number % 16 == 15) {
      much += 0.3;
      (void)moving.noteMoved();
    }
    moving.rebuild(3, pose_of, on_moved);
    const SE3 T = odomAt(number);
    Mesh mesh = meshAt(T, number);
    moving.add(mesh, number / 4, T, pose_of(number / 4, T));
  }
  EXPECT_GE(moving.counters().rebuilds, 1u);
  EXPECT_GT(moved_tiles, 0);
  moving.finish(pose_of, on_moved);

  fusion::QuadtreeMap fresh(mapConfig());
  for (int number = 0; number < 60; ++number) {
    Mesh mesh = meshAt(odomAt(number), number);
    transform(mesh, pose_of(number / 4, odomAt(number)));
    (void)fresh.fuse(mesh);
  }
  expectEqual(fusion::toMesh(moving.map()), fusion::toMesh(fresh));
}

TEST(MovingMap, DuringARebuildTheOldMapIsShownWhole) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  for (int number = 0; number < 20; ++number) {
    Mesh mesh = meshAt(odomAt(number), number);
    moving.add(mesh, number / 4, odomAt(number), odomAt(number));
  }
  const Mesh before = fusion::toMesh(moving.map());
  EXPECT_TRUE(moving.noteMoved());
  EXPECT_FALSE(moving.noteMoved());
  for (int k = 0; k < 6; ++k) {
    moving.rebuild(3, pose_of, {});
    expectEqual(fusion::toMesh(moving.map()), before);
  }
  EXPECT_EQ(moving.counters().waiting, 2u);
  moving.rebuild(3, pose_of, {});
  EXPECT_EQ(moving.counters().rebuilds, 1u);
  EXPECT_GT(moving.map().fused(), 20u);
}

TEST(MovingMap, ADiskThatFailsLeavesTheMapAsItIs) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  for (int number = 0; number < 40; ++number) {
    slots.fails = number > 20;
    Mesh mesh = meshAt(odomAt(number), number);
    moving.add(mesh, number / 4, odomAt(number), odomAt(number));
  }
  const Mesh before = fusion::toMesh(moving.map());
  (void)moving.noteMoved();
  for (int k = 0; k < 40; ++k) moving.rebuild(3, pose_of, {});
  moving.finish(pose_of, {});
  EXPECT_EQ(moving.counters().meshes_lost, 19u);
  EXPECT_TRUE(moving.counters().given_up);
  expectEqual(fusion::toMesh(moving.map()), before);
}

TEST(MovingMap, MeshesLostDuringARebuildStopIt) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  for (int number = 0; number < 40; ++number) {
    Mesh mesh = meshAt(odomAt(number), number);
    moving.add(mesh, number / 4, odomAt(number), odomAt(number));
  }
  const Mesh before = fusion::toMesh(moving.map());
  (void)moving.noteMoved();
  slots.fails = true;
  for (int k = 0; k < 40; ++k) moving.rebuild(3, pose_of, {});
  EXPECT_TRUE(moving.counters().given_up);
  expectEqual(fusion::toMesh(moving.map()), before);
}

TEST(MovingMap, WithoutSlotsItHasOneMapThatStays) {
  MovingMap moving(mapConfig(), nullptr, kPoints);
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap with(mapConfig(), &slots, kPoints);
  EXPECT_LT(moving.memoryBytes(), with.memoryBytes());
  Mesh mesh = meshAt(odomAt(0), 0);
  EXPECT_GT(moving.add(mesh, -1, odomAt(0), odomAt(0)), 0u);
  EXPECT_FALSE(moving.noteMoved());
}

}  // namespace
}  // namespace fathom::onboard
