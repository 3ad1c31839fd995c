#include "recon/solver/incremental/growing_factor.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>
#include <vector>

namespace fathom::slam {
namespace {

constexpr int kN = kBlockSize;

Block randomBlock(std::mt19937& random) {
  std::normal_distribution<double> normal;
  Block b;
  for (double& v : b.v) v = normal(random);
  return b;
}

// A factor and the dense matrix that it should be the factor of.
class GrowingFactorTest : public ::testing::Test {
 protected:
  static constexpr int kPoses = 12;

  explicit GrowingFactorTest(std::int64_t blocks = 200)
      : arena_(GrowingFactor::bytes({kPoses, kPoses, blocks})), factor_({kPoses, kPoses, blocks}, arena_) {
    for (int i = 0; i < kPoses; ++i) {
      EXPECT_TRUE(factor_.append(i));
      change(1, randomBlock(random_), i, -1);
    }
  }

  void change(double sign, const Block& b, int pose_a, int pose_b) {
    addDense(sign, b, pose_a, pose_b);
    factor_.update(sign, b, pose_a, pose_b);
  }

  void addDense(double sign, const Block& b, int pose_a, int pose_b) {
    Eigen::Matrix<double, kN, kN* kPoses> row = Eigen::Matrix<double, kN, kN * kPoses>::Zero();
    const Eigen::Map<const Eigen::Matrix<double, kN, kN>> m(b.v);
    row.middleCols<kN>(kN * pose_a) = m;
    if (pose_b >= 0) row.middleCols<kN>(kN * pose_b) = -m;
    dense_ += sign * row.transpose() * row;
  }

  void expectSolves() {
    const Eigen::VectorXd right = Eigen::VectorXd::Random(kN * kPoses);
    Eigen::VectorXd x(kN * kPoses);
    factor_.solve(right.data(), x.data(), 0);
    EXPECT_LT((dense_ * x - right).norm(), 1e-8 * right.norm());
  }

  std::mt19937 random_{7};
  rt::Arena arena_;
  GrowingFactor factor_;
  Eigen::MatrixXd dense_ =
      GrowingFactor::kLeastInformation * Eigen::MatrixXd::Identity(kN * kPoses, kN* kPoses);
};

TEST_F(GrowingFactorTest, SolvesWhatWasAddedAndAgainAfterSomeIsTakenAway) {
  std::vector<Block> blocks;
  const std::vector<std::array<int, 2>> ends = {{0, 1},  {4, 1}, {11, 0}, {3, 7},
                                                {7, 11}, {2, 9}, {5, 6},  {6, 2}};
  for (const auto& [a, b] : ends) {
    blocks.push_back(randomBlock(random_));
    change(1, blocks.back(), a, b);
    expectSolves();
  }
  for (std::size_t k = 0; k < ends.size(); k += 2) {
    change(-1, blocks[k], ends[k][0], ends[k][1]);
    expectSolves();
  }
}

TEST_F(GrowingFactorTest, ItsCovariancesAreThoseOfTheDenseInverse) {
  for (int i = 1; i < kPoses; ++i) change(1, randomBlock(random_), i, i - 1);
  change(1, randomBlock(random_), 2, 10);
  const Eigen::MatrixXd inverse = dense_.inverse();
  for (const auto& [a, b] : std::vector<std::array<int, 2>>{{3, 8}, {11, 0}, {2, 10}}) {
    Eigen::Matrix<double, 12, 12> both, expected;
    factor_.covariance(a, b, both.data());
    expected << inverse.block<kN, kN>(kN * a, kN * a), inverse.block<kN, kN>(kN * a, kN * b),
        inverse.block<kN, kN>(kN * b, kN * a), inverse.block<kN, kN>(kN * b, kN * b);
    EXPECT_LT((both - expected).norm(), 1e-9 * expected.norm());
    Eigen::Matrix<double, kN, kN> one;
    factor_.covariance(a, -1, one.data());
    EXPECT_LT((one - expected.topLeftCorner<kN, kN>()).norm(), 1e-9 * expected.norm());
  }
  expectSolves();  // nothing is left behind
}

TEST_F(GrowingFactorTest, PartsThatTheRightSideDoesNotReachStayExactlyZero) {
  change(1, randomBlock(random_), 0, 1);
  change(1, randomBlock(random_), 2, 3);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(kN * kPoses), x(kN * kPoses);
  right(kN * 2) = 1;
  factor_.solve(right.data(), x.data(), 1e-30);
  for (int i = 0; i < kPoses; ++i) EXPECT_EQ(x.segment<kN>(kN * i).isZero(0), i != 2 && i != 3) << i;
}

TEST_F(GrowingFactorTest, AMeasurementThatWasNotThereIsNotTakenBelowPositive) {
  Block huge{};
  for (int i = 0; i < kN; ++i) huge(i, i) = 1e3;
  factor_.update(-1, huge, 4, -1);
  const Eigen::VectorXd right = Eigen::VectorXd::Random(kN * kPoses);
  Eigen::VectorXd x(kN * kPoses);
  factor_.solve(right.data(), x.data(), 0);
  EXPECT_TRUE(x.allFinite());
  EXPECT_GT(right.dot(x), 0);
}

class SmallStore : public GrowingFactorTest {
 protected:
  static constexpr std::int64_t kStore = 30;
  SmallStore() : GrowingFactorTest(kStore) {}
};

TEST_F(SmallStore, AMeasurementWithoutRoomIsRefusedWholeAndTheFactorIsThatOfTheOthers) {
  int refused = 0;
  for (int i = 1; i < kPoses; ++i) {
    for (int k = 0; k < i; k += 3) {
      const Block b = randomBlock(random_);
      if (factor_.update(1, b, i, k) == GrowingFactor::kNoRoom)
        ++refused;
      else
        addDense(1, b, i, k);
      EXPECT_LE(factor_.storeUsed(), kStore);
    }
  }
  EXPECT_GT(refused, 0);
  EXPECT_GT(factor_.blocksInUse(), 0);
  EXPECT_FALSE(factor_.append(kPoses));
  expectSolves();
}

// In a store that columns which move would fill, with what they leave behind: the same factor.
TEST(GrowingFactor, ColumnsAreMovedTogetherBeforeAMeasurementIsRefused) {
  constexpr int kMany = 60;
  constexpr std::int64_t kPlenty = 10000, kTight = 3500;
  rt::Arena arena(GrowingFactor::bytes({kMany, kMany, kPlenty}) +
                  GrowingFactor::bytes({kMany, kMany, kTight}));
  GrowingFactor ample({kMany, kMany, kPlenty}, arena), tight({kMany, kMany, kTight}, arena);
  std::mt19937 random(5);
  for (int i = 0; i < kMany; ++i) {
    for (GrowingFactor* f : {&ample, &tight}) ASSERT_TRUE(f->append(i));
    for (const int from : {i - 1, i - 7, (i * 5) % 11}) {
      if (from < 0 || from >= i) continue;
      const Block b = randomBlock(random);
      ASSERT_NE(ample.update(1, b, i, from), GrowingFactor::kNoRoom);
      ASSERT_NE(tight.update(1, b, i, from), GrowingFactor::kNoRoom) << i << " " << from;
    }
  }
  EXPECT_GT(ample.storeUsed(), kTight);
  EXPECT_LE(tight.storeUsed(), kTight);
  EXPECT_EQ(tight.blocksInUse(), ample.blocksInUse());
  const Eigen::VectorXd right = Eigen::VectorXd::Random(kN * kMany);
  Eigen::VectorXd x(kN * kMany), y(kN * kMany);
  ample.solve(right.data(), x.data(), 0);
  tight.solve(right.data(), y.data(), 0);
  EXPECT_EQ(x, y);
}

TEST_F(SmallStore, WhatIsToBeSparedIsLeftFree) {
  const Block b = randomBlock(random_);
  EXPECT_EQ(factor_.update(1, b, 0, 1, kStore), GrowingFactor::kNoRoom);
  EXPECT_GT(factor_.update(1, b, 0, -1, kStore), 0) << "takes no room";
  EXPECT_GT(factor_.update(1, b, 0, 1, kStore / 2), 0);
  EXPECT_LE(factor_.storeUsed(), kStore / 2);
}

TEST(ColumnKernels, EveryInstructionSetGivesTheSameBits) {
  const ColumnKernels& a = baselineColumnKernels();
  const ColumnKernels& b = fastestColumnKernels();
  std::mt19937 random(3);
  std::vector<Block> column(5), other(9);
  for (Block& block : column) block = randomBlock(random);
  for (Block& block : other) block = randomBlock(random);
  const int rows[5] = {8, 0, 3, 7, 5}, place[9] = {1, 2, 3, 4, 5, 6, 7, 8, 0};
  Block diagonal = randomBlock(random), w = randomBlock(random);
  for (int i = 0; i < kN; ++i) diagonal(i, i) = 10 + i;
  Reflections reflections;
  Block rotated = diagonal, rest = w;
  reflect(rotated, rest, 1, reflections);
  const auto run = [&](const ColumnKernels& kernels) {
    std::vector<Block> blocks = column, to = other;
    kernels.subtractProducts(blocks.data(), rows, 5, w, place, to.data());
    kernels.solveFromRight(blocks.data(), 5, diagonal);
    kernels.applyReflections(blocks.data(), rows, 5, reflections, to.data());
    kernels.forwardSix(blocks.data(), rows, 5, w, to.data());
    std::vector<double> x(kN, 0.7), y(9 * kN, 0.3);
    kernels.forward(blocks.data(), rows, 5, x.data(), y.data());
    kernels.backward(blocks.data(), rows, 5, y.data(), x.data());
    x.insert(x.end(), y.begin(), y.end());
    for (const Block& block : blocks) x.insert(x.end(), block.v, block.v + kN * kN);
    for (const Block& block : to) x.insert(x.end(), block.v, block.v + kN * kN);
    return x;
  };
  EXPECT_EQ(run(a), run(b));
}

}  // namespace
}  // namespace fathom::slam
