#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "recon/geometry/uncertain_pose.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"
#include "tests/world/graphs.hpp"

namespace fathom::slam {
namespace {

constexpr double kShift = 0.02, kTurn = 0.004;  // standard deviations of a measurement [m], [rad]

// A vehicle that goes round and round, in a pool of poses: each new one
// takes the place of one that is retired, and is joined to the pose before
// it and to those it comes near. Noise is not that of the informations.
class Rounds {
 public:
  static constexpr int kPool = 30, kRound = 24, kKept = 8;

  Rounds(std::int64_t quota, unsigned seed) : solver_(configOf(quota)), random_(seed) {}

  void addOne() {
    const double angle = 2 * 3.14159265358979 * born_ / kRound;
    const SE3 truth = SE3::fromEuler(0, 0.1, angle, {5 * std::cos(angle), 5 * std::sin(angle), 0.01 * born_});
    if (solver_.living() == kPool && !retireOne()) return;
    int index = -1;
    SE3 start = truth;
    if (last_ >= 0) start = solver_.pose(last_) * (truths_[at(last_)].inverse() * truth) * noise(1);
    ASSERT_EQ(solver_.addPose(start, &index), AddStatus::kOk);
    if (at(index) == truths_.size()) truths_.emplace_back();
    truths_[at(index)] = truth;
    ++born_;
    for (int other = 0; other < solver_.size(); ++other) {
      if (other == index || solver_.isRetired(other)) continue;
      const SE3 between = truths_[at(other)].inverse() * truth;
      if (other != last_ && between.translation().norm() > 1) continue;
      int k = -1;
      ASSERT_EQ(solver_.addMeasurement(
                    {other, index, between * noise(0.7), test::informationOf(kShift, kTurn)}, &k),
                AddStatus::kOk);
      if (other != last_ && k % 3 == 0) (void)solver_.setWeight(k, 0.5);
    }
    last_ = index;
  }

  // As a batch solver has the measurements that are left: the farthest pose [m, rad], and the least and the
  // greatest of a variance by the solver over the true one.
  struct Comparison {
    double distance = 0, least = 1e9, greatest = 0;
  };
  Comparison compare() {
    const std::vector<RelativePose> edges = measurementsOf(solver_);
    std::vector<SE3> poses;
    for (int i = 0; i < solver_.size(); ++i) poses.push_back(solver_.pose(i));
    for (int round = 0; round < 5; ++round) step(poses, edges);
    const Eigen::MatrixXd truth = covarianceOf(poses, edges);
    Comparison c;
    for (int i = 1; i < solver_.size(); ++i) {
      c.distance = std::max(c.distance, (poses[at(i)].inverse() * solver_.pose(i)).log().norm());
      const Vector6d ratio =
          relativeEigenvalues(solver_.covariance(i), truth.block<6, 6>(6 * (i - 1), 6 * (i - 1)));
      c.least = std::min(c.least, ratio(0));
      c.greatest = std::max(c.greatest, ratio(5));
    }
    return c;
  }

  IncrementalSolver& solver() { return solver_; }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  static IncrementalConfig configOf(std::int64_t quota) {
    IncrementalConfig config{.max_poses = kPool, .max_measurements = 400, .max_factor_blocks = 2000};
    config.build_quota = config.urgent_quota = quota;
    config.rebuild_after = 1;  // one factor after the other
    config.kept_last = 8;
    return config;
  }

  bool retireOne() {
    const int old = solver_.leastNeeded(kKept);
    return old >= 0 && solver_.retire(old) == RetireStatus::kOk;
  }

  SE3 noise(double scale) {
    Vector6d x;
    for (int i = 0; i < 6; ++i) x(i) = scale * (i < 3 ? kShift : kTurn) * normal_(random_);
    return SE3::exp(x);
  }

  static void step(std::vector<SE3>& poses, const std::vector<RelativePose>& edges) {
    const auto n = static_cast<Eigen::Index>(6 * poses.size());
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(n);
    for (const RelativePose& e : edges) {
      const RelativePoseLinear l = linearize(e, poses[at(e.from)], poses[at(e.to)]);
      gradient.segment<6>(6 * e.from) += l.by_from.transpose() * e.information * l.error;
      gradient.segment<6>(6 * e.to) += l.by_to.transpose() * e.information * l.error;
    }
    const Eigen::VectorXd move =
        informationOf(poses, edges).bottomRightCorner(n - 6, n - 6).llt().solve(-gradient.tail(n - 6));
    for (std::size_t i = 1; i < poses.size(); ++i)
      poses[i] = perturbed(poses[i], move.segment<6>(6 * static_cast<Eigen::Index>(i - 1)));
  }

  IncrementalSolver solver_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  std::vector<SE3> truths_;  // by index
  int born_ = 0, last_ = -1;
};

// Slices of the next factor from a column or two to all of it, so that poses come and go at many moments of
// its making: before, between and after its columns, while it takes in what is new, and when it is taken up.
TEST(Retirement, AtAnyMomentOfTheNextFactorLeavesSolutionAndCovariancesOfABatch) {
  for (const std::int64_t quota : {40, 70, 110, 160, 240, 400, 700, 1200, 5000}) {
    Rounds rounds(quota, static_cast<unsigned>(quota));
    for (int i = 0; i < 240; ++i) {
      rounds.addOne();
      // A pose that went while the factor was built has no part in it when it is taken up.
      if (rounds.solver().step().factors_replaced > 0) {
        EXPECT_LT(rounds.compare().greatest, 1.09) << "quota " << quota << ", pose " << i;
      }
      if (i % 40 != 39) continue;
      for (int k = 0; k < 40; ++k) (void)rounds.solver().step();
      const Rounds::Comparison c = rounds.compare();
      EXPECT_LT(c.distance, 8e-4) << "quota " << quota << ", pose " << i;
      EXPECT_GT(c.least, 0.88) << "quota " << quota << ", pose " << i;
      EXPECT_LT(c.greatest, 1.06) << "quota " << quota << ", pose " << i;
    }
    EXPECT_GT(rounds.solver().retired(), 100) << "quota " << quota;
  }
}

}  // namespace
}  // namespace fathom::slam
