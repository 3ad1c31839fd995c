#include "realtime/onboard/map/moving_map.hpp"

#include <gtest/gtest.h>

#include "realtime/onboard/map/mesh_slot.hpp"
#include "tests/onboard/rolling_meshes.hpp"
#include "tests/onboard/synthetic_survey.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::onboard {
namespace {

using testing::expectEqual;
using testing::kPoints;
using testing::MemorySlots;
using testing::meshAt;
using testing::odomAt;

const calibration::RigHistory kRigs{StereoRig{}};  // never known better

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

std::string bytesOf(const fusion::QuadtreeMap& map) {
  return map.canonicalBytes();
}

std::unique_ptr<fusion::QuadtreeMap> fusedAfresh(int meshes, const MovingMap::PoseOf& pose_of) {
  auto fresh = std::make_unique<fusion::QuadtreeMap>(mapConfig());
  for (int number = 0; number < meshes; ++number) {
    Mesh mesh = meshAt(odomAt(number), number);
    transform(mesh, pose_of(number / 4, odomAt(number)));
    (void)fresh->fuse(mesh);
  }
  return fresh;
}

void addMeshes(MovingMap& moving, int meshes, MemorySlots* failing = nullptr, int fails_from = 0) {
  for (int number = 0; number < meshes; ++number) {
    if (failing != nullptr) failing->fails = number >= fails_from;
    Mesh mesh = meshAt(odomAt(number), number);
    moving.add(mesh, number / 4, odomAt(number), odomAt(number));
  }
}

TEST(MovingMap, AfterKeyframesMovedItIsTheMapFusedAfreshFromTheFinalPoses) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  double much = 0;
  const MovingMap::PoseOf pose_of = [&](int k, const SE3& T) { return correction(k, much) * T; };
  int moved_meshes = 0;
  const MovingMap::OnMoved on_moved = [&](const auto&, const auto&) { ++moved_meshes; };
  for (int number = 0; number < 60; ++number) {
    if (number % 16 == 15) {
      much += 0.3;
      EXPECT_TRUE(moving.noteMoved());
    }
    moving.rebuild(3, pose_of, on_moved);
    const SE3 T = odomAt(number);
    Mesh mesh = meshAt(T, number);
    moving.add(mesh, number / 4, T, pose_of(number / 4, T));
  }
  EXPECT_GT(moved_meshes, 0);
  moving.finish(pose_of, on_moved);
  EXPECT_EQ(moving.counters().waiting, 0u);
  EXPECT_EQ(moving.map().counters().missing, 0u);
  const auto fresh = fusedAfresh(60, pose_of);
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(*fresh));
  expectEqual(fusion::toMesh(moving.map()), fusion::toMesh(*fresh));
}

// A rig turned by a fifth of a degree towards the other camera: all that it saw was 8 % too near.
TEST(MovingMap, MeshesOfAnOutdatedRigAreTriangulatedAgain) {
  StereoRig nominal, found;
  nominal.left = nominal.right = {680, 512, 900, 900, 340, 256};
  nominal.T_right_left = SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0});
  found = nominal;
  found.T_right_left =
      SE3(Eigen::Quaterniond(Eigen::AngleAxisd(0.0035, Eigen::Vector3d::UnitY())), Eigen::Vector3d::Zero()) *
      nominal.T_right_left;
  calibration::RigHistory rigs(nominal);
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, rigs);
  const MovingMap::PoseOf pose_of = [](int, const SE3& T) { return T; };
  fusion::QuadtreeMap fresh(mapConfig());
  for (int number = 0; number < 30; ++number) {
    if (number == 20) {
      rigs.add(found, true);
      EXPECT_TRUE(moving.noteMoved());
    }
    moving.rebuild(1, pose_of, {});
    const SE3 T = odomAt(number);
    Mesh mesh = meshAt(T, number), corrected = mesh;
    if (number < 20) calibration::retriangulate(nominal, found, corrected);
    transform(corrected, T);
    (void)fresh.fuse(corrected);
    moving.add(mesh, 0, T, T);
  }
  moving.finish(pose_of, {});
  EXPECT_EQ(moving.counters().meshes_fused_again, 20u);
  expectEqual(fusion::toMesh(moving.map()), fusion::toMesh(fresh));
}

TEST(MovingMap, AMeshAtAPredictedPoseMovesToTheFinalOne) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 0.1) * T; };
  for (int number = 0; number < 20; ++number) {
    const SE3 guessed = odomAt(number) * SE3::fromEuler(0.01, 0, 0.02, {0.02, -0.01, 0.005});
    Mesh mesh = meshAt(odomAt(number), number);
    const std::size_t slot =
        moving.add(mesh, (number - 1) / 4, guessed, pose_of((number - 1) / 4, guessed)).slot;
    moving.correct(slot, guessed, number / 4, odomAt(number), pose_of);
    // Another mesh's slot by now: it stays as it is.
    moving.correct(slot, guessed, 0, SE3(), pose_of);
    EXPECT_EQ(moving.counters().waiting, 1u);
    moving.rebuild(1, pose_of, {});
    EXPECT_EQ(moving.counters().waiting, 0u);
  }
  EXPECT_EQ(moving.counters().meshes_fused_again, 20u);
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(*fusedAfresh(20, pose_of)));
}

TEST(MovingMap, WhatWaitsIsWorkedOffWithinTheQuotaLargestMoveFirstAndThenNothingIsLeft) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  addMeshes(moving, 20);
  std::vector<double> moves;
  const MovingMap::OnMoved on_moved = [&](const MovingMap::Box& before, const MovingMap::Box& now) {
    moves.push_back(static_cast<double>((now.low - before.low).norm()));
  };
  moving.noteMoved();
  std::size_t expected = 0;
  for (int k = 0; k < 10; ++k) {
    const std::uint64_t before = moving.counters().meshes_fused_again;
    moving.rebuild(3, pose_of, on_moved);
    EXPECT_LE(moving.counters().meshes_fused_again - before, 3u);
    if (k == 0) expected = moving.counters().waiting;
  }
  EXPECT_EQ(moves.size(), 20u);
  EXPECT_EQ(expected, 17u);
  EXPECT_GT(moves.front(), 2 * moves.back());
  EXPECT_EQ(moving.counters().waiting, 0u);
  EXPECT_EQ(moving.counters().rebuilds, 1u);
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(*fusedAfresh(20, pose_of)));
}

TEST(MovingMap, WhileMeshesWaitEachIsStillInTheMapOnce) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  addMeshes(moving, 20);
  moving.noteMoved();
  for (int k = 0; k < 6; ++k) {
    moving.rebuild(3, pose_of, {});
    const fusion::QuadtreeMap::Counters c = moving.map().counters();
    const auto there = static_cast<double>(c.observations - c.removed);
    fusion::QuadtreeMap whole(mapConfig());
    for (int number = 0; number < 20; ++number) {
      Mesh mesh = meshAt(odomAt(number), number);
      transform(mesh, odomAt(number));
      (void)whole.fuse(mesh);
    }
    // A turned mesh meets the middles of a few cells more or fewer.
    EXPECT_NEAR(there, static_cast<double>(whole.counters().observations), 0.02 * there);
  }
}

TEST(MovingMap, MovesTooSmallToMatterWaitUntilTheyHaveGrownOrTheSurveyEnds) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  double shift = 0.0015;
  const MovingMap::PoseOf pose_of = [&](int, const SE3& T) {
    return SE3(Eigen::Quaterniond::Identity(), {shift, 0, 0}) * T;
  };
  addMeshes(moving, 20);
  moving.noteMoved();
  moving.rebuild(100, pose_of, {});
  EXPECT_EQ(moving.counters().meshes_fused_again, 0u);
  shift += 0.0015;
  moving.noteMoved();
  moving.rebuild(100, pose_of, {});
  EXPECT_EQ(moving.counters().meshes_fused_again, 20u);
  shift += 0.0005;
  moving.noteMoved();
  moving.rebuild(100, pose_of, {});
  EXPECT_EQ(moving.counters().meshes_fused_again, 20u);
  moving.finish(pose_of, {});
  EXPECT_EQ(moving.counters().meshes_fused_again, 40u);
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(*fusedAfresh(20, pose_of)));
}

// As when a loop closes late in a dive; the same at full size is in the report.
TEST(MovingMap, AClosureThatMovesTheLastTenthKeepsTheQuotaAndEndsInTheMapBuiltAfresh) {
  constexpr int kMeshes = 400, kMoved = 40, kQuota = 6;
  MemorySlots slots(kMeshes, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) {
    return k < (kMeshes - kMoved) / 4 ? T : correction(k % 10, 1) * T;
  };
  addMeshes(moving, kMeshes);
  const std::string before = bytesOf(moving.map());
  moving.noteMoved();
  int pairs = 0;
  for (std::uint64_t last = 0; pairs == 0 || moving.counters().waiting > 0; ++pairs) {
    moving.rebuild(kQuota, pose_of, {});
    EXPECT_LE(moving.counters().meshes_fused_again - last, static_cast<std::uint64_t>(kQuota));
    last = moving.counters().meshes_fused_again;
  }
  EXPECT_EQ(pairs, (kMoved + kQuota - 1) / kQuota);
  EXPECT_EQ(moving.counters().meshes_fused_again, static_cast<std::uint64_t>(kMoved));
  EXPECT_FALSE(bytesOf(moving.map()) == before);
  EXPECT_EQ(moving.map().counters().coarsened, 0u);
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(*fusedAfresh(kMeshes, pose_of)));
}

TEST(MovingMap, MeshesThatCouldNotBeStoredStayWhereTheyAre) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  addMeshes(moving, 40, &slots, 21);
  slots.fails = false;
  moving.noteMoved();
  for (int k = 0; k < 40; ++k) moving.rebuild(3, pose_of, {});
  moving.finish(pose_of, {});
  EXPECT_EQ(moving.counters().meshes_lost, 19u);
  EXPECT_TRUE(moving.counters().given_up);
  fusion::QuadtreeMap mixed(mapConfig());
  for (int number = 0; number < 40; ++number) {
    Mesh mesh = meshAt(odomAt(number), number);
    transform(mesh, number < 21 ? pose_of(number / 4, odomAt(number)) : odomAt(number));
    (void)mixed.fuse(mesh);
  }
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(mixed));
}

TEST(MovingMap, ADiskThatFailsOrGivesOtherBytesBackChangesNothing) {
  for (const bool wrong_bytes : {false, true}) {
    MemorySlots slots(100, meshSlotBytes(kPoints));
    MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
    const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
    addMeshes(moving, 40);
    const std::string before = bytesOf(moving.map());
    if (wrong_bytes) {
      const Mesh other = meshAt(odomAt(77), 77);
      std::vector<std::uint8_t> block(meshSlotBytes(kPoints));
      (void)writeMeshSlot(other, block);
      for (std::size_t slot = 0; slot < 40; ++slot) (void)slots.write(slot, block);
    }
    slots.fails = !wrong_bytes;
    moving.noteMoved();
    for (int k = 0; k < 40; ++k) moving.rebuild(3, pose_of, {});
    EXPECT_EQ(moving.counters().meshes_lost, 40u);
    EXPECT_TRUE(bytesOf(moving.map()) == before);
  }
}

// Keyframe 3 retires onto 4 when the poses have moved once, and they move on.
TEST(MovingMap, MeshesOfAKeyframeThatRetiresStayWhereTheyAreAndFollowTheOneTheyHangOnThen) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  double much = 1;
  const MovingMap::PoseOf before = [&](int k, const SE3& T) { return correction(k, much) * T; };
  addMeshes(moving, 40);
  moving.noteMoved();
  moving.rebuild(100, before, {});
  const std::string map = bytesOf(moving.map());
  const std::uint64_t fused = moving.counters().meshes_fused_again;
  const SE3 T_onto = correction(4, much).inverse() * correction(3, much);
  moving.rehang({3, 4, T_onto});
  moving.noteMoved();
  moving.rebuild(100, before, {});
  EXPECT_EQ(moving.counters().meshes_fused_again, fused);
  EXPECT_TRUE(bytesOf(moving.map()) == map);
  much = 2;
  moving.finish(before, {});
  const MovingMap::PoseOf after = [&](int k, const SE3& T) {
    return k == 3 ? correction(4, much) * (T_onto * T) : correction(k, much) * T;
  };
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(*fusedAfresh(40, after)));
}

TEST(MovingMap, FullOfMeshesThoseThatHaveLainStillForLongestAreBakedIn) {
  MemorySlots slots(20, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  addMeshes(moving, 20);
  // The first keyframe's four meshes move: they have not moved for less long than the others from then on.
  moving.noteMoved();
  moving.rebuild(100, [&](int k, const SE3& T) { return k == 0 ? correction(5, 1) * T : T; }, {});
  ASSERT_EQ(moving.counters().meshes_fused_again, 4u);
  for (int number = 20; number < 30; ++number) {
    Mesh mesh = meshAt(odomAt(number), number);
    moving.add(mesh, number / 4, odomAt(number), odomAt(number));
  }
  EXPECT_EQ(moving.counters().meshes_baked_in, 10u);
  EXPECT_EQ(moving.counters().meshes_lost, 0u);
  EXPECT_FALSE(moving.counters().given_up);
  moving.finish(pose_of, {});
  fusion::QuadtreeMap mixed(mapConfig());
  for (int number = 0; number < 30; ++number) {
    const bool baked_in = number >= 4 && number < 14;
    Mesh mesh = meshAt(odomAt(number), number);
    transform(mesh, baked_in ? odomAt(number) : pose_of(number / 4, odomAt(number)));
    (void)mixed.fuse(mesh);
  }
  EXPECT_TRUE(bytesOf(moving.map()) == bytesOf(mixed));
}

TEST(MovingMap, MovingMeshesAllocatesNothing) {
  MemorySlots slots(100, meshSlotBytes(kPoints));
  MovingMap moving(mapConfig(), &slots, kPoints, kRigs);
  addMeshes(moving, 40);
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) { return correction(k, 1) * T; };
  const test::ThreadCost before = test::threadCost();
  moving.noteMoved();
  for (int k = 0; k < 20; ++k) moving.rebuild(3, pose_of, {});
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0u);
  EXPECT_EQ(moving.counters().meshes_fused_again, 40u);
}

TEST(MovingMap, WithoutSlotsItStays) {
  MovingMap moving(mapConfig(), nullptr, kPoints, kRigs);
  Mesh mesh = meshAt(odomAt(0), 0);
  EXPECT_GT(moving.add(mesh, -1, odomAt(0), odomAt(0)).cells, 0u);
  EXPECT_FALSE(moving.noteMoved());
}

}  // namespace
}  // namespace fathom::onboard
