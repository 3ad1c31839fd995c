#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/navigation/graph/navigation_graph.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/saved_state.hpp"
#include "tests/world/dive.hpp"

namespace fathom::slam {
namespace {

using test::savedState, testing::driveOn, testing::errorsOf, testing::smallConfig, testing::SyntheticDive;
using testing::SyntheticDiveOptions;

// A navigation graph that was saved and loaded has the same poses, and comes to the same end.

bool load(NavigationGraph& graph, std::span<const std::uint8_t> bytes) {
  rt::StateReader reader(bytes);
  return graph.load(reader);
}

bool samePose(const SE3& a, const SE3& b) {
  return a.translation() == b.translation() && a.rotation().coeffs() == b.rotation().coeffs();
}

// With what the weights and the gates have to do.
SyntheticDiveOptions trouble() {
  return SyntheticDiveOptions{.wild_fixes = 0.2, .jump_at = 60, .jump = 0.3};
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
  IncrementalConfig config{.max_poses = 60, .max_measurements = 200, .max_factor_blocks = 5000};
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

// A navigation graph continues in the memory of a part of its dive.

constexpr int kPool = 300;

NavigationConfig pooled() {
  NavigationConfig config;
  config.max_keyframes = kPool;
  config.max_links = 6 * kPool;
  config.max_fixes = kPool;
  return config;
}

SyntheticDiveOptions longSurvey(int lines) {
  return SyntheticDiveOptions{.lines = lines, .line_length = 35, .line_spacing = 0.6, .closure_share = 0.1};
}

std::size_t at(int k) {
  return static_cast<std::size_t>(k);
}

// Poses of all keyframes of a dive: those that have retired hang on others.
class Track {
 public:
  void note(const NavigationGraph& graph, const SE3& T_odom_cam) {
    hangs_.push_back({graph.keyframes() - 1, T_odom_cam});
    for (const NavigationGraph::Retired& gone : graph.retired())
      for (Hangs& h : hangs_)
        if (h.on == gone.keyframe) h = {gone.onto, gone.T_onto * h.T_odom};
  }
  [[nodiscard]] std::vector<SE3> poses(const NavigationGraph& graph) const {
    std::vector<SE3> poses;
    for (const Hangs& h : hangs_)
      poses.push_back(graph.pose(h.on) * graph.odometry(h.on).inverse() * h.T_odom);
    return poses;
  }

 private:
  struct Hangs {
    int on;
    SE3 T_odom;
  };
  std::vector<Hangs> hangs_;
};

// What both ends of a link that the pool had room for say, all at once.
std::vector<SE3> batchOf(const SyntheticDive& survey, const SyntheticDiveOptions& options,
                         const std::vector<SyntheticDive::Link>& closures) {
  SyntheticDive kept = survey;
  kept.closures = closures;
  testing::Measured measured = measuredOf(kept, options.usbl_sigma);
  return solveNavigation({}, kept.inputs, kept.anchor, options.anchor_sigma, measured.links, measured.fixes)
      .poses;
}

double rmsOf(const std::vector<SE3>& poses, const std::vector<SE3>& truth, int from, int to) {
  double sum = 0;
  for (int k = from; k < to; ++k)
    sum += (poses[at(k)].translation() - truth[at(k)].translation()).head<2>().squaredNorm();
  return std::sqrt(sum / (to - from));
}

TEST(LongDive, TenTimesThePoolEndsNearTheBatchSolutionAndNoPoseJumpsWhenAKeyframeRetires) {
  const SyntheticDiveOptions options = longSurvey(40);
  const SyntheticDive survey = testing::makeDive(options);
  const int all = static_cast<int>(survey.inputs.size());
  ASSERT_GT(all, 9 * kPool);
  NavigationGraph graph(pooled());
  Track track;
  graph.setAnchor(survey.anchor, options.anchor_sigma);
  std::vector<SyntheticDive::Link> closures;  // of which both ends are there
  double jump = 0;
  for (int k = 0; k < all; ++k) {
    const std::vector<SE3> before = k % 100 == 99 ? track.poses(graph) : std::vector<SE3>();
    ASSERT_EQ(graph.addKeyframe(survey.inputs[at(k)]), k);
    track.note(graph, survey.inputs[at(k)].T_odom_cam);
    if (!before.empty()) {
      const std::vector<SE3> after = track.poses(graph);
      for (std::size_t i = 0; i < before.size(); ++i)
        jump = std::max(jump, (after[i].translation() - before[i].translation()).norm());
    }
    testing::measure(graph, survey, options, k);
    for (const SyntheticDive::Link& link : survey.closures)
      if (link.b == k && graph.has(link.a)) closures.push_back(link);
  }
  for (int i = 0; i < 30; ++i) (void)graph.step();
  const NavigationGraph::Counters& c = graph.counters();
  EXPECT_EQ(c.keyframes, static_cast<std::uint64_t>(all));
  EXPECT_EQ(c.keyframes_refused, 0U);
  EXPECT_GT(c.keyframes_retired, static_cast<std::uint64_t>(all - kPool));
  EXPECT_EQ(c.fixes, survey.fixes.size());
  EXPECT_EQ(c.links_contradicting, 0U);
  EXPECT_LT(jump, 1e-9);
  // Chi2 of what is left stays that of so many keyframes.
  EXPECT_LT(graph.solver().chi2(), 12.0 * kPool);

  const std::vector<SE3> poses = track.poses(graph), batch = batchOf(survey, options, closures);
  const double error = errorsOf(poses, survey.truth).absolute, least = errorsOf(batch, survey.truth).absolute;
  double worst = 0;
  for (int from = 0; from + 60 <= all; from += 60)
    worst = std::max(
        worst, rmsOf(poses, survey.truth, from, from + 60) - rmsOf(batch, survey.truth, from, from + 60));
  EXPECT_LT(error, 1.2 * least);
  EXPECT_LT(worst, 0.2) << "metres above the batch solution in some minute";
}

TEST(LongDive, YawingToAndFroTakesFewReferencesAndCirclingLeavesRoomForEveryFrame) {
  NavigationConfig config;
  config.max_keyframes = 9000;
  config.max_links = config.max_fixes = 10;
  NavigationGraph yawing(config), circling(config);
  constexpr double kInterval = 0.5, kYaw = 0.21, kPeriod = 7, kRound = 15, kTurn = 2 * std::numbers::pi;
  for (int k = 0; k < config.max_keyframes; ++k) {
    const double t = k * kInterval;
    KeyframeInput input{
        .utc_ns = static_cast<std::int64_t>(t * 1e9),
        .T_odom_cam = SE3::fromEuler(0, 0, kYaw * std::sin(kTurn * t / kPeriod), {0.3 * t, 0, 10})};
    ASSERT_TRUE(yawing.addKeyframe(input)) << k;
    const double around = kTurn * t / kRound;
    input.T_odom_cam = SE3::fromEuler(0, 0, around, {3 * std::cos(around), 3 * std::sin(around), 10});
    ASSERT_TRUE(circling.addKeyframe(input)) << k;
  }
  EXPECT_LT(yawing.counters().references, 1000U);
  EXPECT_LT(circling.counters().references, 2500U);
}

class LongDiveState : public ::testing::Test {
 protected:
  SyntheticDiveOptions options = longSurvey(10);
  SyntheticDive survey = testing::makeDive(options);
  int all = static_cast<int>(survey.inputs.size());
  NavigationGraph whole{pooled()}, loaded{pooled()}, again{pooled()};
  std::vector<std::uint8_t> state;

  void SetUp() override {
    whole.setAnchor(survey.anchor, options.anchor_sigma);
    driveOn(whole, survey, options, 2 * all / 3);
    state = test::savedState(whole);
  }
  static bool load(NavigationGraph& graph, std::span<const std::uint8_t> bytes) {
    rt::StateReader reader(bytes);
    return graph.load(reader);
  }
};

TEST_F(LongDiveState, WithRetiredKeyframesItIsSavedAndLoadedBitByBitAndGoesOnAlike) {
  ASSERT_GT(whole.counters().keyframes_retired, 0U);
  ASSERT_TRUE(load(loaded, state));
  ASSERT_TRUE(load(again, state));
  EXPECT_EQ(test::savedState(loaded), state);
  ASSERT_TRUE(std::ranges::equal(loaded.living(), whole.living()));
  for (const int k : whole.living()) EXPECT_EQ(loaded.pose(k).translation(), whole.pose(k).translation());
  for (NavigationGraph* graph : {&whole, &loaded, &again}) driveOn(*graph, survey, options, all);
  EXPECT_EQ(test::savedState(loaded), test::savedState(again));
  EXPECT_EQ(loaded.counters().keyframes, whole.counters().keyframes);
  EXPECT_LT((loaded.pose(all - 1).translation() - whole.pose(all - 1).translation()).norm(), 0.01);
}

TEST_F(LongDiveState, DamageIsRefusedOrDoesNoHarm) {
  int refused = 0, loads = 0;
  test::eachDamage(state, 60, [&](auto bytes) {
    ++loads;
    if (load(loaded, bytes))
      driveOn(loaded, survey, options, loaded.keyframes() + 2);
    else
      ++refused;
  });
  EXPECT_LT(refused, loads);
}

TEST_F(LongDiveState, RetiringTakesNoMemory) {
  const test::ThreadCost before = test::threadCost();
  for (int k = whole.keyframes(); k < all; ++k) {
    (void)whole.addKeyframe(survey.inputs[at(k)]);
    (void)whole.step();
  }
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0U);
}

}  // namespace
}  // namespace fathom::slam
