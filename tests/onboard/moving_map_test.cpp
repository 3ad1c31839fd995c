#include "realtime/onboard/map/moving_map.hpp"

#include <gtest/gtest.h>

#include <climits>
#include "tests/onboard/rolling_meshes.hpp"
#include "tests/onboard/synthetic_survey.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::onboard {
namespace {

using testing::kPoints, testing::meshAt, testing::odomAt;

const calibration::RigHistory kRigs{StereoRig{}};  // never known better

// Keyframes are every fourth mesh; they have drifted by more the later they came.
SE3 correction(int keyframe, double much) {
  return SE3::fromEuler(0, 0, 0.01 * much * keyframe,
                        {0.03 * much * keyframe, -0.02 * much * keyframe, 0.01});
}

fusion::QuadtreeConfig mapConfig() {
  return fusion::QuadtreeConfig{.root_size = 8, .max_level = 3, .max_tiles = 512};
}

// Those for which `moves` says no, where odometry has them.
std::unique_ptr<fusion::QuadtreeMap> fusedAfresh(
    int meshes, const MovingMap::PoseOf& pose_of, bool (*moves)(int) = [](int) { return true; }) {
  auto fresh = std::make_unique<fusion::QuadtreeMap>(mapConfig());
  for (int number = 0; number < meshes; ++number) {
    Mesh mesh = meshAt(odomAt(number), number);
    transform(mesh, moves(number) ? pose_of(number / 4, odomAt(number)) : odomAt(number));
    (void)fresh->fuse(mesh);
  }
  return fresh;
}

MovingMap::PoseOf corrected(double much) {
  return [much](int k, const SE3& T) { return correction(k, much) * T; };
}

struct MapWithSlots {
  explicit MapWithSlots(std::size_t of = 100) : slots(of, meshSlotBytes(kPoints)) {}
  // Meshes where odometry has them.
  void add(int from, int to, int fails_from = INT_MAX) {
    for (int number = from; number < to; ++number) {
      slots.fails = number >= fails_from;
      Mesh mesh = meshAt(odomAt(number), number);
      map.add(mesh, number / 4, odomAt(number), odomAt(number));
    }
    slots.fails = false;
  }
  testing::MemorySlots slots;
  MovingMap map{mapConfig(), &slots, kPoints, kRigs};
};

TEST(MovingMap, AfterKeyframesMovedItIsTheMapFusedAfreshFromTheFinalPoses) {
  MapWithSlots made;
  MovingMap& moving = made.map;
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
  EXPECT_TRUE(moving.map().canonicalBytes() == fresh->canonicalBytes());
  testing::expectEqual(fusion::toMesh(moving.map()), fusion::toMesh(*fresh));
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
  testing::MemorySlots slots(100, meshSlotBytes(kPoints));
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
  testing::expectEqual(fusion::toMesh(moving.map()), fusion::toMesh(fresh));
}

TEST(MovingMap, AMeshAtAPredictedPoseMovesToTheFinalOne) {
  MapWithSlots made;
  MovingMap& moving = made.map;
  const MovingMap::PoseOf pose_of = corrected(0.1);
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
  EXPECT_TRUE(moving.map().canonicalBytes() == fusedAfresh(20, pose_of)->canonicalBytes());
}

TEST(MovingMap, WhatWaitsIsWorkedOffWithinTheQuotaLargestMoveFirstAndThenNothingIsLeft) {
  MapWithSlots made;
  MovingMap& moving = made.map;
  const MovingMap::PoseOf pose_of = corrected(1);
  made.add(0, 20);
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
  EXPECT_TRUE(moving.map().canonicalBytes() == fusedAfresh(20, pose_of)->canonicalBytes());
}

TEST(MovingMap, WhileMeshesWaitEachIsStillInTheMapOnce) {
  MapWithSlots made;
  MovingMap& moving = made.map;
  const MovingMap::PoseOf pose_of = corrected(1);
  made.add(0, 20);
  moving.noteMoved();
  for (int k = 0; k < 6; ++k) {
    moving.rebuild(3, pose_of, {});
    const fusion::QuadtreeMap::Counters c = moving.map().counters();
    const auto there = static_cast<double>(c.observations - c.removed);
    const auto whole = fusedAfresh(20, [](int, const SE3& T) { return T; });
    // A turned mesh meets the middles of a few cells more or fewer.
    EXPECT_NEAR(there, static_cast<double>(whole->counters().observations), 0.02 * there);
  }
}

TEST(MovingMap, MovesTooSmallToMatterWaitUntilTheyHaveGrownOrTheSurveyEnds) {
  MapWithSlots made;
  MovingMap& moving = made.map;
  double shift = 0.0015;
  const MovingMap::PoseOf pose_of = [&](int, const SE3& T) {
    return SE3(Eigen::Quaterniond::Identity(), {shift, 0, 0}) * T;
  };
  made.add(0, 20);
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
  EXPECT_TRUE(moving.map().canonicalBytes() == fusedAfresh(20, pose_of)->canonicalBytes());
}

// As when a loop closes late in a dive; the same at full size is in the report.
TEST(MovingMap, AClosureThatMovesTheLastTenthKeepsTheQuotaAndEndsInTheMapBuiltAfresh) {
  constexpr int kMeshes = 400, kMoved = 40, kQuota = 6;
  MapWithSlots made(kMeshes);
  MovingMap& moving = made.map;
  const MovingMap::PoseOf pose_of = [](int k, const SE3& T) {
    return k < (kMeshes - kMoved) / 4 ? T : correction(k % 10, 1) * T;
  };
  made.add(0, kMeshes);
  const std::string before = moving.map().canonicalBytes();
  moving.noteMoved();
  int pairs = 0;
  for (std::uint64_t last = 0; pairs == 0 || moving.counters().waiting > 0; ++pairs) {
    moving.rebuild(kQuota, pose_of, {});
    EXPECT_LE(moving.counters().meshes_fused_again - last, static_cast<std::uint64_t>(kQuota));
    last = moving.counters().meshes_fused_again;
  }
  EXPECT_EQ(pairs, (kMoved + kQuota - 1) / kQuota);
  EXPECT_EQ(moving.counters().meshes_fused_again, static_cast<std::uint64_t>(kMoved));
  EXPECT_FALSE(moving.map().canonicalBytes() == before);
  EXPECT_EQ(moving.map().counters().coarsened, 0u);
  EXPECT_TRUE(moving.map().canonicalBytes() == fusedAfresh(kMeshes, pose_of)->canonicalBytes());
}

TEST(MovingMap, MeshesThatCouldNotBeStoredStayWhereTheyAre) {
  MapWithSlots made;
  MovingMap& moving = made.map;
  const MovingMap::PoseOf pose_of = corrected(1);
  made.add(0, 40, 21);
  moving.noteMoved();
  for (int k = 0; k < 40; ++k) moving.rebuild(3, pose_of, {});
  moving.finish(pose_of, {});
  EXPECT_EQ(moving.counters().meshes_lost, 19u);
  EXPECT_TRUE(moving.counters().given_up);
  EXPECT_TRUE(moving.map().canonicalBytes() ==
              fusedAfresh(40, pose_of, [](int number) { return number < 21; })->canonicalBytes());
}

TEST(MovingMap, ADiskThatFailsOrGivesOtherBytesBackChangesNothing) {
  for (const bool wrong_bytes : {false, true}) {
    MapWithSlots made;
    MovingMap& moving = made.map;
    const MovingMap::PoseOf pose_of = corrected(1);
    made.add(0, 40);
    const std::string before = moving.map().canonicalBytes();
    if (wrong_bytes) {
      std::vector<std::uint8_t> block(meshSlotBytes(kPoints));
      (void)writeMeshSlot(meshAt(odomAt(77), 77), block);
      for (std::size_t slot = 0; slot < 40; ++slot) (void)made.slots.write(slot, block);
    }
    made.slots.fails = !wrong_bytes;
    moving.noteMoved();
    for (int k = 0; k < 40; ++k) moving.rebuild(3, pose_of, {});
    EXPECT_EQ(moving.counters().meshes_lost, 40u);
    EXPECT_TRUE(moving.map().canonicalBytes() == before);
  }
}

// Keyframe 3 retires onto 4 when the poses have moved once, and they move on.
TEST(MovingMap, MeshesOfAKeyframeThatRetiresStayWhereTheyAreAndFollowTheOneTheyHangOnThen) {
  MapWithSlots made;
  MovingMap& moving = made.map;
  double much = 1;
  const MovingMap::PoseOf before = [&](int k, const SE3& T) { return correction(k, much) * T; };
  made.add(0, 40);
  moving.noteMoved();
  moving.rebuild(100, before, {});
  const std::string map = moving.map().canonicalBytes();
  const std::uint64_t fused = moving.counters().meshes_fused_again;
  const SE3 T_onto = correction(4, much).inverse() * correction(3, much);
  moving.reattach({3, 4, T_onto});
  moving.noteMoved();
  moving.rebuild(100, before, {});
  EXPECT_EQ(moving.counters().meshes_fused_again, fused);
  EXPECT_TRUE(moving.map().canonicalBytes() == map);
  much = 2;
  moving.finish(before, {});
  const MovingMap::PoseOf after = [&](int k, const SE3& T) {
    return k == 3 ? correction(4, much) * (T_onto * T) : correction(k, much) * T;
  };
  EXPECT_TRUE(moving.map().canonicalBytes() == fusedAfresh(40, after)->canonicalBytes());
}

TEST(MovingMap, FullOfMeshesThoseThatHaveLainStillForLongestAreBakedIn) {
  MapWithSlots made(20);
  MovingMap& moving = made.map;
  const MovingMap::PoseOf pose_of = corrected(1);
  made.add(0, 20);
  // The first keyframe's four meshes move: they have not moved for less long than the others from then on.
  moving.noteMoved();
  moving.rebuild(100, [&](int k, const SE3& T) { return k == 0 ? correction(5, 1) * T : T; }, {});
  ASSERT_EQ(moving.counters().meshes_fused_again, 4u);
  made.add(20, 30);
  EXPECT_EQ(moving.counters().meshes_baked_in, 10u);
  EXPECT_EQ(moving.counters().meshes_lost, 0u);
  EXPECT_FALSE(moving.counters().given_up);
  moving.finish(pose_of, {});
  const auto not_baked_in = [](int number) { return number < 4 || number >= 14; };
  EXPECT_TRUE(moving.map().canonicalBytes() == fusedAfresh(30, pose_of, not_baked_in)->canonicalBytes());
}

TEST(MovingMap, MovingMeshesAllocatesNothing) {
  MapWithSlots made;
  MovingMap& moving = made.map;
  made.add(0, 40);
  const MovingMap::PoseOf pose_of = corrected(1);
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
