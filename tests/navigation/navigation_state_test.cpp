// A navigation graph that was saved and loaded has the same poses, and comes to the same end.
#include <gtest/gtest.h>

#include "recon/navigation/graph/navigation_graph.hpp"
#include "tests/navigation/synthetic_dive.hpp"
#include "tests/support/saved_state.hpp"

namespace fathom::slam {
namespace {

using test::savedState;
using testing::driveOn;
using testing::smallConfig;
using testing::SyntheticDive;
using testing::SyntheticDiveOptions;

bool load(NavigationGraph& graph, std::span<const std::uint8_t> bytes) {
  rt::StateReader reader(bytes);
  return graph.load(reader);
}

bool samePose(const SE3& a, const SE3& b) {
  return a.translation() == b.translation() && a.rotation().coeffs() == b.rotation().coeffs();
}

// With what the weights and the gates have to do.
SyntheticDiveOptions trouble() {
  SyntheticDiveOptions options;
  options.wild_fixes = 0.2;
  options.jump_at = 60;
  options.jump = 0.3;
  return options;
}

class NavigationState : public ::testing::Test {
 protected:
  SyntheticDiveOptions options = trouble();
  SyntheticDive survey = testing::makeDive(options);
  int all = static_cast<int>(survey.inputs.size());
  std::vector<std::uint8_t> state;
  NavigationGraph whole{smallConfig()}, loaded{smallConfig()};

  void driveAndLoad(int keyframes) {
    whole.setAnchor(survey.anchor, options.anchor_sigma);
    driveOn(whole, survey, options, keyframes);
    state = savedState(whole);
    ASSERT_TRUE(load(loaded, state));
  }
};

TEST_F(NavigationState, EveryPoseAndCountIsTheSame) {
  driveAndLoad(2 * all / 3);
  ASSERT_EQ(loaded.keyframes(), whole.keyframes());
  for (int k = 0; k < whole.keyframes(); ++k) EXPECT_TRUE(samePose(loaded.pose(k), whole.pose(k))) << k;
  EXPECT_TRUE(samePose(loaded.T_nav_odom(), whole.T_nav_odom()));
  EXPECT_EQ(loaded.deviation(), whole.deviation());
  EXPECT_EQ(loaded.changesWaiting(), whole.changesWaiting());
  EXPECT_EQ(loaded.dvl().scale(), whole.dvl().scale());
  EXPECT_EQ(savedState(loaded), state);
  // The same factor but for where it was linearised.
  for (int k = 5; k < whole.keyframes(); k += 7) {
    const Matrix6d before = whole.covariance(k), after = loaded.covariance(k);
    EXPECT_LT((after - before).norm(), 0.02 * before.norm()) << k;
  }
}

TEST_F(NavigationState, TheSurveyEndsWhereItWouldHaveEnded) {
  driveAndLoad(all / 2);
  for (NavigationGraph* graph : {&whole, &loaded}) {
    driveOn(*graph, survey, options, all);
    for (int i = 0; i < 100; ++i) (void)graph->step();
  }
  ASSERT_EQ(loaded.keyframes(), whole.keyframes());
  EXPECT_EQ(loaded.counters().closures, whole.counters().closures);
  EXPECT_EQ(loaded.counters().fixes, whole.counters().fixes);
  for (int k = 0; k < whole.keyframes(); ++k)
    EXPECT_LT((loaded.pose(k).translation() - whole.pose(k).translation()).norm(), 0.002) << k;
}

TEST_F(NavigationState, TwoThatWereLoadedGoOnBitByBitAlike) {
  driveAndLoad(all / 2);
  NavigationGraph again(smallConfig());
  driveOn(again, survey, options, all / 3);  // forgotten
  ASSERT_TRUE(load(again, state));
  for (NavigationGraph* graph : {&again, &loaded}) driveOn(*graph, survey, options, all);
  EXPECT_EQ(savedState(again), savedState(loaded));
}

TEST_F(NavigationState, AGraphWithoutKeyframesIsSavedAndLoaded) {
  driveAndLoad(0);
  for (NavigationGraph* graph : {&whole, &loaded}) driveOn(*graph, survey, options, all);
  EXPECT_EQ(loaded.keyframes(), all);
  EXPECT_EQ(loaded.counters().closures, whole.counters().closures);
}

TEST_F(NavigationState, OneThatHasNoRoomForItRefuses) {
  driveAndLoad(all / 2);
  NavigationConfig config = smallConfig();
  config.max_keyframes = all / 4;
  NavigationGraph smaller(config);
  EXPECT_FALSE(load(smaller, state));
}

TEST_F(NavigationState, DamageIsRefusedOrDoesNoHarm) {
  driveAndLoad(all / 3);
  test::eachRefused(state, 40, [&](auto bytes) { return load(loaded, bytes); });
  int refused = 0, loads = 0;
  test::eachDamage(state, 250, [&](auto bytes) {
    ++loads;
    if (load(loaded, bytes))
      driveOn(loaded, survey, options, loaded.keyframes() + 2);
    else
      ++refused;
  });
  EXPECT_GT(refused, 0);
  EXPECT_LT(refused, loads);
  ASSERT_TRUE(load(loaded, state));
}

TEST(SolverState, ASolverWithRetiredPosesGoesOn) {
  IncrementalConfig config;
  config.max_poses = 60;
  config.max_measurements = 200;
  config.max_factor_blocks = 5000;
  const Matrix6d information = 100 * Matrix6d::Identity();
  const auto walkOn = [&](IncrementalSolver& solver, int& last, int steps) {
    for (int i = 0; i < steps; ++i) {
      while (solver.living() > 40) {
        const int pose = solver.leastNeeded(8);
        if (pose < 0 || solver.retire(pose) != RetireStatus::kOk) break;
      }
      int next = -1;
      const SE3 step(Eigen::Quaterniond::Identity(), {0.3, 0.01 * (i % 3), 0});
      ASSERT_EQ(solver.addPose(solver.pose(last) * step, &next), AddStatus::kOk);
      ASSERT_EQ(solver.addMeasurement({last, next, step, information}), AddStatus::kOk);
      last = next;
      (void)solver.step();
    }
  };
  IncrementalSolver whole(config), loaded(config);
  int last = -1;
  ASSERT_EQ(whole.addPose(SE3(), &last), AddStatus::kOk);
  walkOn(whole, last, 100);
  ASSERT_GT(whole.retired(), 0);
  const std::vector<std::uint8_t> state = savedState(whole);
  rt::StateReader reader(state);
  ASSERT_TRUE(loaded.load(reader)) << reader.failure();
  EXPECT_EQ(loaded.living(), whole.living());
  EXPECT_EQ(loaded.retired(), whole.retired());
  EXPECT_EQ(savedState(loaded), state);
  int last_loaded = last;
  walkOn(whole, last, 50);
  walkOn(loaded, last_loaded, 50);
  EXPECT_GT(loaded.retired(), 50);
  EXPECT_NEAR((loaded.pose(last_loaded).translation() - whole.pose(last).translation()).norm(), 0, 1e-6);
}

}  // namespace
}  // namespace fathom::slam
