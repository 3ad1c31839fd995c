#include "recon/solver/batch/block_cholesky.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>
#include <vector>

namespace fathom::slam {
namespace {

TEST(BlockCholesky, SolvesWhatADenseSolverSolvesInEitherOrderOfPairs) {
  constexpr int kBlocks = 30, kSize = 3;
  std::mt19937 random(4);
  std::uniform_int_distribution<int> any(0, kBlocks - 1);
  std::vector<BlockCholesky::Pair> pairs;
  for (int i = 1; i < kBlocks; ++i) pairs.push_back({i, i - 1});
  for (int i = 0; i < 25; ++i) {
    const int a = any(random), b = any(random);
    if (a != b) pairs.push_back({a, b});
  }
  pairs.push_back(pairs.front());  // once more
  BlockCholesky system(kBlocks, kSize, pairs);
  for (int round = 0; round < 2; ++round) {  // the second time over the first one's values
    system.setZero();
    Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(kBlocks * kSize, kBlocks * kSize);
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const Eigen::Matrix3d m = Eigen::Matrix3d::Random();
      system.addPair(k, m);
      dense.block<kSize, kSize>(pairs[k][0] * kSize, pairs[k][1] * kSize) += m;
      dense.block<kSize, kSize>(pairs[k][1] * kSize, pairs[k][0] * kSize) += m.transpose();
    }
    const Eigen::Matrix3d heavy = 30 * Eigen::Matrix3d::Identity() + Eigen::Matrix3d::Ones();
    for (int i = 0; i < kBlocks; ++i) {
      system.addDiagonal(i, heavy);
      dense.block<kSize, kSize>(i * kSize, i * kSize) += heavy;
    }
    const Eigen::MatrixXd right = Eigen::MatrixXd::Random(kBlocks * kSize, 2);
    ASSERT_TRUE(system.factorize());
    EXPECT_LT((dense * system.solve(right) - right).norm(), 1e-10);
    ASSERT_TRUE(system.factorize(0.5));
    Eigen::MatrixXd damped = dense;
    damped.diagonal() *= 1.5;
    EXPECT_LT((damped * system.solve(right) - right).norm(), 1e-10);
  }
}

TEST(BlockCholesky, AMatrixThatIsNotPositiveDefiniteIsRefused) {
  const std::vector<BlockCholesky::Pair> pairs{{0, 1}};
  BlockCholesky system(2, 1, pairs);
  system.addDiagonal(0, Eigen::MatrixXd::Ones(1, 1));
  system.addDiagonal(1, Eigen::MatrixXd::Ones(1, 1));
  system.addPair(0, 2 * Eigen::MatrixXd::Ones(1, 1));
  EXPECT_FALSE(system.factorize());
  EXPECT_TRUE(system.factorize(2));
}

}  // namespace
}  // namespace fathom::slam
