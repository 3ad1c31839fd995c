// Saved and loaded state continues: map and meshes, localisation, and all cores through a whole mission.
#include <gtest/gtest.h>

#include <algorithm>
#include "realtime/onboard/map/moving_map.hpp"
#include "recon/closure/frame_features.hpp"
#include "tests/onboard/cores_run.hpp"
#include "tests/onboard/synthetic_survey.hpp"
#include "tests/support/lattice_mesh.hpp"
#include "tests/support/saved_state.hpp"

namespace fathom::onboard {
namespace {

using test::savedState, testing::CoresRun, testing::featureSlots, testing::MemorySlots;
using testing::smallLocalisation, testing::SyntheticSurvey;

const calibration::RigHistory kRigs{StereoRig{}};  // never known better

bool samePose(const SE3& a, const SE3& b) {
  return a.translation() == b.translation() && a.rotation().coeffs() == b.rotation().coeffs();
}

template <typename T>
bool load(T& object, std::span<const std::uint8_t> bytes) {
  rt::StateReader reader(bytes);
  return object.load(reader);
}

void dive(LocalisationCore& core, const SyntheticSurvey& made, std::size_t from, std::size_t to) {
  std::size_t fix = 0;
  for (std::size_t k = 0; k < to; ++k) {
    for (; fix < made.fixes.size() && made.fixes[fix].arrival_ns <= made.frames[k].utc_ns; ++fix)
      if (k >= from) made.fixes[fix].addTo(core);
    if (k >= from) made.frames[k].placeIn(core);
  }
}

class LocalisationRestart : public ::testing::Test {
 protected:
  SyntheticSurvey made = testing::syntheticSurvey();
  std::size_t middle = made.frames.size() / 2, end = made.frames.size();
  MemorySlots slots = featureSlots(300), copy = slots, second = slots;
  LocalisationCore whole{made.rigs, smallLocalisation(), &slots};
  std::vector<std::uint8_t> state;

  void SetUp() override {
    whole.setAnchor(nav::FixKind::kGps, {3.3, -2.2}, 0.5);
    dive(whole, made, 0, middle);
    state = savedState(whole);
    copy = second = slots;
  }
};

TEST_F(LocalisationRestart, KeyframesAreWhereTheyWereAndTheDiveEndsAtTheSamePlaces) {
  LocalisationCore loaded(made.rigs, smallLocalisation(), &copy),
      again(made.rigs, smallLocalisation(), &second);
  ASSERT_TRUE(load(loaded, state));
  ASSERT_TRUE(load(again, state));
  ASSERT_EQ(loaded.keyframes(), whole.keyframes());
  for (int k = 0; k < whole.keyframes(); ++k) {
    EXPECT_TRUE(samePose(loaded.keyframePose(k), whole.keyframePose(k))) << k;
    EXPECT_EQ(loaded.features().has(k), whole.features().has(k));
  }
  EXPECT_EQ(savedState(loaded), state);
  for (LocalisationCore* core : {&whole, &loaded, &again}) {
    dive(*core, made, middle, end);
    core->finish();
  }
  EXPECT_EQ(savedState(again), savedState(loaded));  // every load gives the same
  ASSERT_EQ(loaded.keyframes(), whole.keyframes());
  EXPECT_GT(loaded.graph().counters().closures, 1u);
  EXPECT_EQ(loaded.features().counters().read_failures, 0u);
  for (int k = 0; k < whole.keyframes(); ++k)
    EXPECT_LT((loaded.keyframePose(k).translation() - whole.keyframePose(k).translation()).norm(), 0.01) << k;
}

TEST(LocalisationRestartWithFewKeyframes, AfterSomeHaveRetiredADiveContinuesAlike) {
  const SyntheticSurvey made = testing::syntheticSurvey();
  LocalisationConfig config = smallLocalisation();
  config.max_keyframes = 40;
  MemorySlots slots = featureSlots(40, config);
  LocalisationCore whole(made.rigs, config, &slots);
  whole.setAnchor(nav::FixKind::kGps, {3.3, -2.2}, 0.5);
  const std::size_t middle = 2 * made.frames.size() / 3, end = made.frames.size();
  dive(whole, made, 0, middle);
  ASSERT_GT(whole.graph().counters().keyframes_retired, 10u);
  const std::vector<std::uint8_t> state = savedState(whole);
  MemorySlots copy = slots, second = slots;
  LocalisationCore loaded(made.rigs, config, &copy), again(made.rigs, config, &second);
  ASSERT_TRUE(load(loaded, state));
  ASSERT_TRUE(load(again, state));
  EXPECT_EQ(savedState(loaded), state);
  ASSERT_TRUE(std::ranges::equal(loaded.graph().living(), whole.graph().living()));
  for (const int k : whole.graph().living())
    EXPECT_TRUE(samePose(loaded.keyframePose(k), whole.keyframePose(k))) << k;
  for (LocalisationCore* core : {&whole, &loaded, &again}) {
    dive(*core, made, middle, end);
    core->finish();
  }
  EXPECT_EQ(savedState(again), savedState(loaded));
  EXPECT_EQ(loaded.keyframes(), whole.keyframes());
  const int newest = whole.keyframes() - 1;
  EXPECT_LT((loaded.keyframePose(newest).translation() - whole.keyframePose(newest).translation()).norm(),
            0.01);
}

TEST_F(LocalisationRestart, SlotsThatAreAnotherRunsCostClosuresOnly) {
  MemorySlots wrong = featureSlots(300);
  const std::vector<std::uint8_t> other(wrong.slotBytes(), 3);
  for (std::size_t k = 0; k < wrong.slots(); ++k) ASSERT_TRUE(wrong.write(k, other));
  LocalisationCore loaded(made.rigs, smallLocalisation(), &wrong);
  ASSERT_TRUE(load(loaded, state));
  dive(loaded, made, middle, end);
  EXPECT_GT(loaded.features().counters().read_failures, 0u);
  EXPECT_EQ(loaded.keyframes(), static_cast<int>(loaded.graph().counters().keyframes));
}

TEST_F(LocalisationRestart, DamageIsRefusedOrDoesNoHarm) {
  LocalisationCore loaded(made.rigs, smallLocalisation(), &copy);
  test::eachRefused(state, 20, [&](auto bytes) { return load(loaded, bytes); });
  test::eachDamage(state, 40, [&](auto bytes) {
    if (load(loaded, bytes)) dive(loaded, made, middle, middle + 2);
  });
}

// A mesh of a seafloor that rolls, seen from 2 m above.
Mesh meshOf(int number) {
  constexpr int kSide = 14;
  Mesh mesh;
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j) {
      const float x = 0.1F * static_cast<float>(i), y = 0.1F * static_cast<float>(j);
      mesh.vertices.emplace_back(x, y, 2.0F + 0.1F * std::sin(3 * x + static_cast<float>(number)));
      mesh.sigma.push_back(0.01F);
      mesh.colours.push_back({static_cast<std::uint8_t>(100 + i), static_cast<std::uint8_t>(90 + j), 80});
    }
  mesh.triangles = test::latticeTriangles(kSide, kSide);
  return mesh;
}

class MovingMapRestart : public ::testing::Test {
 protected:
  static constexpr std::size_t kPoints = 400;
  static constexpr int kKeyframes = 25;
  fusion::QuadtreeConfig config{.root_size = 8, .max_level = 3, .max_tiles = 128};
  MemorySlots slots{100, meshSlotBytes(kPoints)};

  static SE3 odomAt(int k) { return SE3::fromEuler(0, 0, 0.1 * k, {0.25 * (k % 20), 0.8 * (k / 20), 10}); }
  static SE3 poseAt(int keyframe, const SE3& T_odom_cam, double moved) {
    return SE3(Eigen::Quaterniond::Identity(), {0.02 * moved * keyframe, 0, 0}) * T_odom_cam;
  }
  static void fly(MovingMap& map, int from, int to) {
    for (int k = from; k < to; ++k) {
      const double moved = k / 20;
      Mesh mesh = meshOf(k);
      if (k % 10 == 0) (void)map.noteMoved();
      map.rebuild(2, [&](int keyframe, const SE3& T) { return poseAt(keyframe, T, moved); }, {});
      (void)map.add(mesh, k / 4, odomAt(k), poseAt(k / 4, odomAt(k), moved));
    }
  }
};

TEST_F(MovingMapRestart, TheMapContinuesBitByBit) {
  MovingMap whole(config, &slots, kPoints, kRigs);
  fly(whole, 0, 45);
  ASSERT_GT(whole.counters().waiting, 0u);
  const std::vector<std::uint8_t> state = savedState(whole);
  MemorySlots copy = slots;
  MovingMap loaded(config, &copy, kPoints, kRigs);
  rt::StateReader reader(state);
  ASSERT_TRUE(loaded.load(reader, [](int keyframe) { return keyframe < kKeyframes; })) << reader.failure();
  EXPECT_EQ(loaded.map().canonicalBytes(), whole.map().canonicalBytes());
  EXPECT_EQ(savedState(loaded), state);
  for (MovingMap* map : {&whole, &loaded}) {
    fly(*map, 45, 90);
    map->finish([](int keyframe, const SE3& T) { return poseAt(keyframe, T, 9); }, {});
  }
  EXPECT_EQ(loaded.counters().meshes_lost, 0u);
  EXPECT_EQ(savedState(loaded), savedState(whole));
}

TEST_F(MovingMapRestart, AMeshOfAKeyframeThatThereIsNotIsRefused) {
  MovingMap whole(config, &slots, kPoints, kRigs), loaded(config, &slots, kPoints, kRigs);
  fly(whole, 0, 45);
  const std::vector<std::uint8_t> state = savedState(whole);
  rt::StateReader reader(state);
  EXPECT_FALSE(loaded.load(reader, [](int keyframe) { return keyframe < 5; }));
}

TEST_F(MovingMapRestart, ATornSlotCostsItsMeshOnly) {
  MovingMap whole(config, &slots, kPoints, kRigs);
  fly(whole, 0, 45);
  const std::vector<std::uint8_t> state = savedState(whole);
  MemorySlots torn = slots;
  std::vector<std::uint8_t> block(1000, 0);
  ASSERT_TRUE(torn.write(30, block));
  MovingMap loaded(config, &torn, kPoints, kRigs);
  rt::StateReader reader(state);
  ASSERT_TRUE(loaded.load(reader, [](int keyframe) { return keyframe < kKeyframes; }));
  loaded.finish([](int keyframe, const SE3& T) { return poseAt(keyframe, T, 9); }, {});
  EXPECT_EQ(loaded.counters().meshes_lost, 1u);
}

// All cores, on a dive whose DVL dies and whose compass jumps, with a ship that answers.
TEST(CoresRestart, AMissionWithARestartGivesTheSameMapPosesAndFrames) {
  const testing::RecordedMission mission(FATHOM_FAULTY_MISSION);
  const auto half = static_cast<std::ptrdiff_t>(mission.inputs.size() / 2);
  MemorySlots features = featureSlots(2000, mission.config.localisation),
              meshes(4000, meshSlotBytes(static_cast<std::size_t>(mission.config.stereo.max_features)));
  testing::Ship ship;
  CoresRun whole(mission, {&features, &meshes}, ship);
  for (auto input = mission.inputs.begin(); input != mission.inputs.begin() + half; ++input)
    whole.consume(*input);
  const std::vector<std::uint8_t> state = savedState(whole);

  MemorySlots features_after = features, meshes_after = meshes;
  testing::Ship ship_after = ship;
  CoresRun loaded(mission, {&features_after, &meshes_after}, ship_after);
  ASSERT_TRUE(load(loaded, state));
  EXPECT_EQ(savedState(loaded), state);
  EXPECT_EQ(loaded.map().map().canonicalBytes(), whole.map().map().canonicalBytes());
  ASSERT_EQ(loaded.map().localisation()->keyframes(), whole.map().localisation()->keyframes());
  for (int k = 0; k < whole.map().localisation()->keyframes(); ++k)
    EXPECT_TRUE(
        samePose(loaded.map().localisation()->keyframePose(k), whole.map().localisation()->keyframePose(k)));

  const std::size_t frames_before = whole.frames().size();
  for (auto input = mission.inputs.begin() + half; input != mission.inputs.end(); ++input) {
    whole.consume(*input);
    loaded.consume(*input);
  }
  EXPECT_EQ(savedState(whole.nav().core()), savedState(loaded.nav().core()));
  for (CoresRun* run : {&whole, &loaded}) run->finish();
  const LocalisationCore &a = *whole.map().localisation(), &b = *loaded.map().localisation();
  ASSERT_EQ(b.keyframes(), a.keyframes());
  const auto apart = [&](int k) {
    return Eigen::Vector3d(a.keyframePose(k).translation() - b.keyframePose(k).translation());
  };
  Eigen::Vector3d all = Eigen::Vector3d::Zero();
  for (int k = 0; k < a.keyframes(); ++k) all += apart(k) / a.keyframes();
  double worst = 0;
  for (int k = 0; k < a.keyframes(); ++k) worst = std::max(worst, (apart(k) - all).norm());
  EXPECT_LT(worst, 0.01);
  // Fixes give the position of the whole to decimetres: iterations end at a small share of that.
  EXPECT_LT(all.norm(), 0.026 * a.positionSigma());
  // As much of the map has crossed the water, and what was acknowledged before was not sent again.
  const auto sent = whole.link().counters(), sent_after = loaded.link().counters();
  EXPECT_NEAR(static_cast<double>(sent_after.blocks.sent), static_cast<double>(sent.blocks.sent),
              0.05 * static_cast<double>(sent.blocks.sent));
  EXPECT_NEAR(static_cast<double>(loaded.frames().size()),
              static_cast<double>(whole.frames().size() - frames_before),
              0.05 * static_cast<double>(whole.frames().size()));
  EXPECT_EQ(ship_after.receiver.counters().resyncs, 0u);
  EXPECT_EQ(loaded.map().movingMap().counters().meshes_lost, 0u);
}

}  // namespace
}  // namespace fathom::onboard
