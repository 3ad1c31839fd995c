#include "recon/solver/incremental/retirement.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"
#include "recon/solver/batch/batch_solver.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/world/graphs.hpp"

namespace fathom::slam {
namespace {

std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

Matrix6d randomInformation(std::mt19937& random, double scale) {
  std::normal_distribution<double> normal;
  Matrix6d a;
  for (int i = 0; i < 36; ++i) a.data()[i] = normal(random);
  return scale * (a * a.transpose() + 0.1 * Matrix6d::Identity());
}

SE3 randomMotion(std::mt19937& random, double shift, double turn) {
  std::normal_distribution<double> normal;
  Vector6d x;
  for (int i = 0; i < 6; ++i) x(i) = (i < 3 ? shift : turn) * normal(random);
  return SE3::exp(x);
}

// A pose, index 0, in a star of others, 1 to n; measurements without error, one of each neighbour.
struct MadeStar {
  std::vector<SE3> poses;
  std::vector<RelativePose> edges;
};

MadeStar syntheticStar(int neighbours, unsigned seed) {
  std::mt19937 random(seed);
  MadeStar star;
  for (int i = 0; i <= neighbours; ++i) star.poses.push_back(randomMotion(random, 2, 0.7));
  for (int i = 1; i <= neighbours; ++i) {
    const bool outwards = i % 2 == 0;
    const int from = outwards ? 0 : i, to = outwards ? i : 0;
    star.edges.push_back({from, to, star.poses[index(from)].inverse() * star.poses[index(to)],
                          randomInformation(random, i == 1 ? 1e6 : 1e5)});
  }
  return star;
}

std::vector<RelativePose> retired(const MadeStar& star) {
  rt::Arena arena(Measurements::bytes(40, 40));
  Measurements measurements(40, 40, arena);
  std::vector<StarLink> links;
  for (std::size_t k = 0; k < star.edges.size(); ++k) {
    const RelativePose& e = star.edges[k];
    EXPECT_EQ(measurements.add(e, static_cast<int>(star.poses.size())), AddStatus::kOk);
    const Measurement* m = &measurements[static_cast<int>(k)];
    const int other = e.from == 0 ? e.to : e.from;
    // Where the poses are now is a little off what was measured.
    std::mt19937 random(static_cast<unsigned>(k));
    links.push_back(starLink(
        {&m, 1}, 0, star.poses[index(other)].inverse() * star.poses[0] * randomMotion(random, 0.1, 0.05)));
    links.back().neighbour = other;
  }
  std::vector<RelativePose> left(kMostLinks);
  left.resize(index(retireStar(links, left)));
  return left;
}

TEST(Retirement, OfAPoseBetweenTwoLeavesTheSchurComplement) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const MadeStar star = syntheticStar(2, seed);
    const std::vector<RelativePose> left = retired(star);
    ASSERT_EQ(left.size(), 1U);
    const SE3 between = star.poses[index(left[0].from)].inverse() * star.poses[index(left[0].to)];
    EXPECT_LT((left[0].T_from_to.inverse() * between).log().norm(), 1e-6);
    const Eigen::MatrixXd exact = marginalOf(informationOf(star.poses, star.edges));
    const Eigen::MatrixXd kept = informationOf(star.poses, left).bottomRightCorner(12, 12);
    EXPECT_LT((kept - exact).norm(), 1e-5 * exact.norm()) << "seed " << seed;
  }
}

TEST(Retirement, OfAPoseAmongMoreNeverLeavesMoreInformationThanThereWas) {
  for (int neighbours = 3; neighbours <= 7; ++neighbours) {
    for (unsigned seed = 1; seed <= 10; ++seed) {
      const MadeStar star = syntheticStar(neighbours, seed);
      const std::vector<RelativePose> left = retired(star);
      ASSERT_EQ(left.size(), index(neighbours - 1));
      const Eigen::MatrixXd exact = marginalOf(informationOf(star.poses, star.edges));
      const Eigen::Index n = exact.rows();
      const Eigen::MatrixXd kept = informationOf(star.poses, left).bottomRightCorner(n, n);
      EXPECT_TRUE(isPositive(exact - kept, 1e-5 * exact.norm()))
          << neighbours << " neighbours, seed " << seed;
      EXPECT_LT(kept.trace(), exact.trace());
      EXPECT_GT(kept.trace(), 0.2 * exact.trace()) << "most of it is kept";
    }
  }
}

// A survey given to a solver that has not the room for it: a pose is retired whenever one more would not fit.
class PooledReplay {
 public:
  static constexpr int kKept = 20;  // newest poses, which are not retired

  PooledReplay(const PoseGraph& whole, int pool, int measurements)
      : graph_(whole), solver_(configOf(pool, measurements)), slot_(whole.poses.size(), -1), room_(pool) {}

  void run() {
    const int poses = static_cast<int>(graph_.poses.size());
    std::vector<std::vector<int>> by_later(graph_.poses.size());
    for (std::size_t k = 0; k < graph_.edges.size(); ++k)
      by_later[index(std::max(graph_.edges[k].from, graph_.edges[k].to))].push_back(static_cast<int>(k));
    std::vector<int> pose_of(index(room_), -1);
    used_.reserve(graph_.edges.size());
    for (int i = 0; i < poses; ++i) {
      const test::ThreadCost before = test::threadCost();
      while (solver_.living() == room_) {
        const int old = solver_.leastNeeded(kKept);
        ASSERT_GE(old, 0) << "pose " << i;
        ASSERT_EQ(solver_.retire(old), RetireStatus::kOk) << "pose " << i;
        slot_[index(pose_of[index(old)])] = -1;
      }
      SE3 start = graph_.poses[index(i)];
      for (const int k : by_later[index(i)])
        if (i > 0 && graph_.edges[index(k)].from == i - 1)
          start = solver_.pose(slot_[index(i - 1)]) * graph_.edges[index(k)].T_from_to;
      int& slot = slot_[index(i)];
      ASSERT_EQ(solver_.addPose(start, &slot), AddStatus::kOk);
      pose_of[index(slot)] = i;
      for (const int k : by_later[index(i)]) {
        RelativePose e = graph_.edges[index(k)];
        if (e.from >= 0) e.from = slot_[index(e.from)];
        if (graph_.edges[index(k)].from >= 0 && e.from < 0) continue;  // that pose has gone
        e.to = slot;
        ASSERT_EQ(solver_.addMeasurement(e), AddStatus::kOk) << "pose " << i;
        used_.push_back(k);
      }
      const StepReport step = solver_.step();
      heap_calls_ += (test::threadCost() - before).heap_calls;
      work_.push_back(step.solve_work + step.update_work + step.build_work);
    }
    for (int i = 0; i < 100; ++i) solver_.step();
  }

  // The graph of all that was used, and its poses where they are most likely.
  [[nodiscard]] PoseGraph batch() const {
    PoseGraph whole = graph_;
    whole.edges.clear();
    for (const int k : used_) whole.edges.push_back(graph_.edges[index(k)]);
    IncrementalSolver all(configOf(static_cast<int>(whole.poses.size()), static_cast<int>(used_.size())));
    for (const SE3& pose : whole.poses) EXPECT_EQ(all.addPose(pose), AddStatus::kOk);
    for (const RelativePose& e : whole.edges) EXPECT_EQ(all.addMeasurement(e), AddStatus::kOk);
    for (int i = 0; i < 100; ++i) all.step();
    for (std::size_t i = 0; i < whole.poses.size(); ++i) whole.poses[i] = all.pose(static_cast<int>(i));
    return whole;
  }

  IncrementalSolver& solver() { return solver_; }
  [[nodiscard]] int slot(std::size_t pose) const { return slot_[pose]; }  // -1: retired
  [[nodiscard]] std::uint64_t heapCalls() const { return heap_calls_; }
  [[nodiscard]] const std::vector<std::int64_t>& work() const { return work_; }  // of each step

 private:
  static IncrementalConfig configOf(int poses, int measurements) {
    IncrementalConfig config;
    config.max_poses = poses;
    config.max_measurements = measurements;
    config.max_factor_blocks = IncrementalConfig::blocksFor(poses, std::max(0, measurements - poses));
    return config;
  }

  const PoseGraph& graph_;
  IncrementalSolver solver_;
  std::vector<int> slot_, used_;
  int room_;
  std::uint64_t heap_calls_ = 0;
  std::vector<std::int64_t> work_;
};

test::Survey smallSurvey(int keyframes, int closures, bool sensors, unsigned seed) {
  return test::makeSurvey({.keyframes = keyframes,
                           .closures = closures,
                           .line_length = 40,
                           .attitude_and_depth = sensors,
                           .seed = seed});
}

// Farthest that a pose which is left is from the batch solution's [m].
double worstPooledDistance(PooledReplay& replay, const PoseGraph& batch) {
  double worst = 0;
  for (std::size_t i = 0; i < batch.poses.size(); ++i)
    if (const int slot = replay.slot(i); slot >= 0)
      worst =
          std::max(worst, (batch.poses[i].translation() - replay.solver().pose(slot).translation()).norm());
  return worst;
}

TEST(Retirement, WithRoomForThreeFifthsOfItsPosesASurveyEndsAtTheBatchSolution) {
  const test::Survey survey = smallSurvey(600, 60, false, 1);
  PooledReplay replay(survey.graph, 360, 420);
  const std::size_t memory = replay.solver().memoryBytes();
  replay.run();
  EXPECT_EQ(replay.solver().retired(), 240);
  EXPECT_EQ(replay.solver().living(), 360);
  EXPECT_EQ(replay.solver().size(), 360);
  EXPECT_EQ(replay.solver().memoryBytes(), memory);
  EXPECT_EQ(replay.heapCalls(), 0U);
  const PoseGraph batch = replay.batch();
  EXPECT_GT(worstPooledDistance(replay, survey.graph), 0.1) << "dead reckoning is elsewhere";
  EXPECT_LT(worstPooledDistance(replay, batch), 0.001);
}

TEST(Retirement, AMissionOfFiveTimesThePoolRunsThroughWithStepsOfTheSameWork) {
  for (const bool sensors : {false, true}) {
    const test::Survey survey = smallSurvey(1000, 100, sensors, 2);
    PooledReplay replay(survey.graph, 200, sensors ? 700 : 300);
    replay.run();
    EXPECT_EQ(replay.solver().retired(), 800);
    EXPECT_EQ(replay.heapCalls(), 0U);
    const auto most = [&](std::size_t first, std::size_t last) {
      return *std::max_element(replay.work().begin() + static_cast<std::ptrdiff_t>(first),
                               replay.work().begin() + static_cast<std::ptrdiff_t>(last));
    };
    EXPECT_LT(most(300, 1000), 3 * most(100, 300));
    const PoseGraph batch = replay.batch();
    // With attitude and depth, what a pose says couples three others, and part of it is lost.
    EXPECT_LT(worstPooledDistance(replay, batch), sensors ? 0.1 : 0.002);
    EXPECT_LT(worstPooledDistance(replay, batch), 0.5 * worstPooledDistance(replay, survey.graph));
  }
}

TEST(Retirement, PosesThatAreLeftAreNeverMoreCertainThanByAllMeasurements) {
  for (const bool sensors : {false, true}) {
    const test::Survey survey = smallSurvey(160, 25, sensors, 3);
    PooledReplay replay(survey.graph, 96, sensors ? 300 : 125);
    replay.run();
    IncrementalSolver& solver = replay.solver();
    const PoseGraph batch = replay.batch();
    const Eigen::MatrixXd full = covarianceOf(batch.poses, batch.edges);
    // What is left, linearised at the same poses.
    std::vector<SE3> poses(index(solver.size()));
    for (std::size_t i = 0; i < batch.poses.size(); ++i)
      if (const int slot = replay.slot(i); slot >= 0) poses[index(slot)] = batch.poses[i];
    std::vector<RelativePose> left;
    for (int k = 0; k < solver.measurements(); ++k) {
      const Measurement& m = solver.measurement(k);
      if (m.in_use) left.push_back({m.from, m.to, m.T_from_to, m.root.transpose() * m.root});
    }
    const Eigen::MatrixXd mine = covarianceOf(poses, left);
    double mean = 0;
    int count = 0;
    for (std::size_t i = 1; i < batch.poses.size(); ++i) {
      const int slot = replay.slot(i);
      if (slot < 0) continue;
      const Eigen::Index a = 6 * (slot - 1), b = 6 * (static_cast<Eigen::Index>(i) - 1);
      const Vector6d ratio = relativeEigenvalues(mine.block<6, 6>(a, a), full.block<6, 6>(b, b));
      EXPECT_GT(ratio(0), 0.98) << "pose " << i << (sensors ? " with sensors" : "");
      mean += ratio.mean();
      ++count;
    }
    EXPECT_EQ(count, 95);
    EXPECT_LT(mean / count, sensors ? 1.3 : 1.001);
  }
}

const SE3 kMetreAhead = SE3::fromEuler(0, 0, 0, {1, 0, 0});

// So many poses a metre apart, each measured from the one before.
void addChain(IncrementalSolver& solver, int poses) {
  for (int i = 0; i < poses; ++i) {
    ASSERT_EQ(solver.addPose(SE3::fromEuler(0, 0, 0, {1.0 * i, 0, 0})), AddStatus::kOk);
    if (i == 0) continue;
    ASSERT_EQ(solver.addMeasurement({i - 1, i, kMetreAhead, Matrix6d::Identity()}), AddStatus::kOk);
  }
}

TEST(Retirement, WhatCannotBeRetiredIsRefusedAndAnIndexIsUsedAgain) {
  IncrementalSolver solver({.max_poses = 4, .max_measurements = 6, .max_factor_blocks = 100});
  EXPECT_EQ(solver.leastNeeded(0), -1);
  addChain(solver, 4);
  EXPECT_EQ(solver.retire(1), RetireStatus::kNotSettled) << "no step has seen its measurements";
  solver.step();
  EXPECT_EQ(solver.retire(-1), RetireStatus::kNoSuchPose);
  EXPECT_EQ(solver.retire(4), RetireStatus::kNoSuchPose);
  EXPECT_EQ(solver.retire(0), RetireStatus::kHeld);
  EXPECT_EQ(solver.addPose(SE3()), AddStatus::kFull);
  const int old = solver.leastNeeded(1);
  ASSERT_TRUE(old == 1 || old == 2);
  EXPECT_EQ(solver.retire(old), RetireStatus::kOk);
  EXPECT_EQ(solver.retire(old), RetireStatus::kNoSuchPose);
  EXPECT_TRUE(solver.isRetired(old));
  EXPECT_EQ(solver.addMeasurement({0, old, kMetreAhead, Matrix6d::Identity()}), AddStatus::kNoSuchPose);
  int index_again = -1;
  EXPECT_EQ(solver.addPose(SE3::fromEuler(0, 0, 0, {4.5, 0, 0}), &index_again), AddStatus::kOk);
  EXPECT_EQ(index_again, old);
  EXPECT_FALSE(solver.isRetired(old));
  ASSERT_EQ(solver.addMeasurement({3, old, kMetreAhead, Matrix6d::Identity()}), AddStatus::kOk);
  for (int i = 0; i < 10; ++i) solver.step();
  EXPECT_NEAR(solver.pose(old).translation().x(), 4, 1e-6);
  EXPECT_NEAR(solver.pose(3).translation().x(), 3, 1e-6) << "still joined to the first";
  EXPECT_NEAR(solver.covariance(3)(0, 0), 3, 1e-3);
}

TEST(Retirement, APoseThatMustStayIsNotNamedAsTheLeastNeeded) {
  IncrementalSolver solver({.max_poses = 6, .max_measurements = 6, .max_factor_blocks = 100});
  addChain(solver, 6);
  solver.step();
  const std::array<std::uint8_t, 4> must_stay = {0, 1, 0, 1};  // nothing is said of the others
  for (const int left : {2, 4}) {
    const int old = solver.leastNeeded(1, must_stay);
    EXPECT_TRUE(old == 2 || old == 4) << old;
    EXPECT_EQ(solver.retire(old), RetireStatus::kOk) << left;
  }
  EXPECT_EQ(solver.leastNeeded(1, must_stay), -1);
  EXPECT_NE(solver.leastNeeded(1), -1);
}

TEST(Retirement, TheSameCallsGiveTheSameBits) {
  const test::Survey survey = smallSurvey(300, 30, true, 4);
  PooledReplay a(survey.graph, 80, 300), b(survey.graph, 80, 300);
  a.run();
  b.run();
  EXPECT_EQ(a.solver().chi2(), b.solver().chi2());
  for (int i = 0; i < a.solver().size(); ++i)
    EXPECT_EQ(a.solver().pose(i).translation(), b.solver().pose(i).translation());
}

}  // namespace
}  // namespace fathom::slam
