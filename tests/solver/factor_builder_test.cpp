#include "recon/solver/incremental/factor_builder.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {
namespace {

constexpr int kBuilderPoses = 40, kMeasurements = 120, kBlocks = 1000;
constexpr int kAhead = 3;  // each pose is measured from so many before it

SE3 poseOf(int i) {
  return SE3::fromEuler(0.01 * i, -0.02 * i, 0.1 * i, {0.3 * i, 0.05 * i * i, 8.0 - 0.01 * i});
}

RelativePose measured(int from, int to, double sigma) {
  return {from, to, poseOf(from).inverse() * poseOf(to), Matrix6d::Identity() / (sigma * sigma)};
}

// A graph, and the factor that is built of it a slice at a time.
struct Built {
  static constexpr FactorBuilder::Size kSize{kBuilderPoses, kMeasurements, 10};
  static constexpr GrowingFactor::Size kFactor{kBuilderPoses, kBuilderPoses, kBlocks};
  rt::Arena arena{Measurements::bytes(kBuilderPoses, kMeasurements) + FactorBuilder::bytes(kSize) +
                  GrowingFactor::bytes(kFactor)};
  Measurements measurements{kBuilderPoses, kMeasurements, arena};
  FactorBuilder builder{kSize, arena};
  GrowingFactor factor{kFactor, arena};
  std::vector<InFactor> in_factor{kMeasurements};

  Built() {
    std::vector<SE3> poses;
    for (int i = 0; i < kBuilderPoses; ++i) {
      poses.push_back(poseOf(i));
      for (int from = std::max(0, i - kAhead); from < i; ++from)
        EXPECT_EQ(measurements.add(measured(from, i, 0.1 + 0.01 * i), kBuilderPoses), AddStatus::kOk);
    }
    std::vector<std::uint8_t> held(kBuilderPoses), newest(kBuilderPoses), left_out(kMeasurements);
    held[0] = 1;
    (void)builder.begin(poses, held, newest, left_out, measurements, 0, factor);
  }
  [[nodiscard]] std::vector<double> solution() {
    std::vector<double> right(6 * kBuilderPoses), x(6 * kBuilderPoses);
    for (std::size_t i = 0; i < right.size(); ++i) right[i] = 0.1 * static_cast<double>(i % 7);
    (void)factor.solve(right.data(), x.data(), 0);
    return x;
  }
  // Gives a measurement's place to one that says something else.
  [[nodiscard]] bool giveAway(int k) {
    measurements.remove(k);
    if (!builder.keep(measurements.nextPlace())) return false;
    int place = -1;
    EXPECT_EQ(measurements.add(measured(kBuilderPoses - 1, k % 5, 3), kBuilderPoses, &place), AddStatus::kOk);
    EXPECT_EQ(place, k);
    return true;
  }
};

TEST(FactorBuilder, BuildsWhatWasThereAtTheStartThoughPlacesBecomeOthers) {
  Built quiet, busy;
  (void)quiet.builder.run(1'000'000, quiet.factor, quiet.in_factor);
  for (int k = 0; k < 10; ++k) {
    (void)busy.builder.run(1, busy.factor, busy.in_factor);
    ASSERT_TRUE(busy.builder.running());
    ASSERT_TRUE(busy.giveAway(11 * k));
    ASSERT_TRUE(busy.giveAway(11 * k)) << "what was kept once need not be kept again";
    busy.measurements.setWeight(11 * k + 1, 0.5);
  }
  (void)busy.builder.run(1'000'000, busy.factor, busy.in_factor);
  EXPECT_EQ(busy.solution(), quiet.solution());
}

TEST(FactorBuilder, SaysWhenTooManyPlacesBecomeOthers) {
  Built built;
  (void)built.builder.run(1, built.factor, built.in_factor);
  for (int k = 0; k < 10; ++k) ASSERT_TRUE(built.giveAway(k));
  EXPECT_FALSE(built.giveAway(10));
  (void)built.builder.run(1'000'000, built.factor, built.in_factor);
  EXPECT_TRUE(built.giveAway(11)) << "nothing is read any more";
}

// Every pose and measurement is another's before a factor is built: it is
// begun again, and poses to come wait until one is.
TEST(FactorBuilder, ASolverContinuesWhenAllPlacesChangeDuringABuild) {
  IncrementalConfig config;
  config.max_poses = 80;
  config.max_measurements = 600;
  config.max_factor_blocks = 8000;
  config.build_quota = config.urgent_quota = 30;
  IncrementalSolver solver(config);
  constexpr int kSteps = 600, kOfPose = 5;
  int last = -1, added = 0;
  ASSERT_EQ(solver.addPose(SE3(), &last), AddStatus::kOk);
  const SE3 step = SE3::fromEuler(0, 0, 0.01, {0.3, 0, 0});
  SE3 truth;
  for (int i = 0; i < 10 * kSteps && added < kSteps; ++i) {
    if (solver.living() > 60)
      if (const int pose = solver.leastNeeded(8); pose >= 0) (void)solver.retire(pose);
    int next = -1;
    if (solver.addPose(solver.pose(last) * step, &next) == AddStatus::kOk) {
      truth = truth * step;
      ASSERT_EQ(solver.addMeasurement({last, next, step, 100 * Matrix6d::Identity()}), AddStatus::kOk);
      for (int k = 0; k < kOfPose; ++k)
        ASSERT_EQ(solver.addMeasurement({kWorld, next, truth, Matrix6d::Identity()}), AddStatus::kOk);
      last = next;
      ++added;
    }
    (void)solver.step();
  }
  EXPECT_EQ(added, kSteps);
  EXPECT_GT(solver.retired(), kSteps / 2);
  EXPECT_NEAR((solver.pose(last).translation() - truth.translation()).norm(), 0, 1e-6);
}

}  // namespace
}  // namespace fathom::slam
