#include "realtime/onboard/map/mesh_slot.hpp"

#include <gtest/gtest.h>

#include "tests/onboard/rolling_meshes.hpp"

namespace fathom::onboard {
namespace {

using testing::expectEqual;
using testing::kPoints;
using testing::meshAt;
using testing::odomAt;

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

}  // namespace
}  // namespace fathom::onboard
