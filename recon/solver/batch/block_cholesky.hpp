#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace fathom::slam {

// Symmetric positive definite matrix of square blocks, and its sparse Cholesky factor (CHOLMOD, supernodal;
// Chen, Davis, Hager & Rajamanickam 2008). The pattern is given once and analysed on the graph of blocks,
// by approximate minimum degree; of large ones nested dissection is tried too and the sparser factor kept.
// Values may change as often as wanted.
class BlockCholesky {
 public:
  using Pair = std::array<int, 2>;
  // Of elimination: for the fewest numbers in the factor; or by nested dissection whatever it costs, so that
  // paths of the elimination tree are short.
  enum class Order : std::uint8_t { kSparsest, kShortPaths };

  // `blocks` diagonal blocks of `size` x `size`, and a block for each pair of different indices. A pair may
  // be given more than once, in either order. Throws std::runtime_error when CHOLMOD runs out of memory.
  BlockCholesky(int blocks, int size, std::span<const Pair> pairs, Order order = Order::kSparsest);
  ~BlockCholesky();
  BlockCholesky(const BlockCholesky&) = delete;
  BlockCholesky& operator=(const BlockCholesky&) = delete;

  void setZero();
  void addDiagonal(int block, const Eigen::Ref<const Eigen::MatrixXd>& values);
  // Values of the block in row pairs[k][0] and column pairs[k][1]; its transpose follows.
  void addPair(std::size_t k, const Eigen::Ref<const Eigen::MatrixXd>& values);
  // The same for blocks of 6 x 6, without a heap call.
  void addDiagonal6(int block, const Eigen::Matrix<double, 6, 6>& values);
  void addPair6(std::size_t k, const Eigen::Matrix<double, 6, 6>& values);

  // Factorises the matrix with its diagonal multiplied by 1 + `damping`
  // (Marquardt 1963); false when that is not positive definite.
  [[nodiscard]] bool factorize(double damping = 0);
  // Solves for one or more right sides, blocks * size long each; needs a factor.
  [[nodiscard]] Eigen::MatrixXd solve(const Eigen::Ref<const Eigen::MatrixXd>& right) const;

  // Z = L^-1 P B of right sides B that are zero outside one block: zero outside the path from that block to
  // the root of the elimination tree, which with nested dissection has O(sqrt n) rows for a survey of n
  // poses. Products of these are parts of the inverse: B_a^T A^-1 B_b = Z_a^T Z_b.
  struct TreePath {
    std::vector<int> part;  // supernodes, rising
    std::vector<int> row;   // first row of each in `value`, and one past the last
    Eigen::MatrixXd value;
    [[nodiscard]] std::size_t bytes() const {
      return static_cast<std::size_t>(value.size()) * sizeof(double);
    }
  };
  // `right`: `size` rows. Several threads may ask at once.
  [[nodiscard]] TreePath pathOf(int block, const Eigen::Ref<const Eigen::MatrixXd>& right) const;
  // (Z_b - Z_a)^T (Z_b - Z_a): what the two share cancels before it is squared. Either may be empty.
  [[nodiscard]] static Eigen::MatrixXd squaredDifference(const TreePath& a, const TreePath& b);

  [[nodiscard]] int dimension() const;
  [[nodiscard]] double factorEntries() const;     // numbers in the factor
  [[nodiscard]] std::size_t memoryBytes() const;  // CHOLMOD's peak use

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::slam
