#pragma once

#include <cstdint>
#include <span>

#include "realtime/kernel/memory/arena.hpp"
#include "recon/solver/block_kernels.hpp"

namespace fathom::slam {

// Cholesky factor L of a sparse symmetric matrix of 6 x 6 blocks, one block row for each pose, that grows in
// fixed memory: a pose is appended at the end of the elimination order, and a measurement between two poses
// is added as an update of rank 6 along the path from its ends to the root of the elimination tree (Davis &
// Hager 2001, here with Householder reflections). A column that outgrows its place moves to the end of the
// store; when that is full, all are moved together. A measurement without room for its fill even then is
// refused whole: the factor is always exactly that of the measurements that it contains.
//
// `position` is a place in the elimination order, `pose` a pose's index.
class GrowingFactor {
 public:
  struct Size {
    int poses = 0;
    int positions = 0;        // at least as many: a pose that was removed leaves its own behind
    std::int64_t blocks = 0;  // below the diagonal
  };
  // Information given to every unknown [1/m^2, 1/rad^2], so that a pose without measurements has a factor:
  // a standard deviation of 30 km.
  static constexpr double kLeastInformation = 1e-9;

  // What a call works on. Factors of one size may share it, as long as only one of them works at a time.
  struct Work {
    Work(const Size& size, rt::Arena& arena);
    static std::size_t bytes(const Size& size);

    std::span<Block> blocks;        // two by position; zero between calls
    std::span<int> pattern, added;  // positions that an update has reached; of these, new to a column
    std::span<int> mark;            // by position: place in the column or in the pattern
    std::span<double> vector;
    std::span<std::uint8_t> reached;
  };

  // Takes its memory from `arena`, which must live longer and hold
  // bytes(size); with work space that others share, bytesBesideWork(size).
  GrowingFactor(const Size& size, rt::Arena& arena) : GrowingFactor(size, arena, Work(size, arena)) {}
  GrowingFactor(const Size& size, rt::Arena& arena, const Work& work);
  static std::size_t bytes(const Size& size) { return bytesBesideWork(size) + Work::bytes(size); }
  static std::size_t bytesBesideWork(const Size& size);

  void clear();
  // Appends a pose that nothing has measured. False when full.
  bool append(int pose);
  // Removes the pose of a position: its unknowns remain with a zero right side, so that the others are solved
  // for as if they had been marginalised.
  void removePose(int position);
  // Adds (`sign` 1) or takes away (-1) [b -b]^T [b -b] at rows and columns of two poses; with pose_b < 0, b^T
  // b of one. What is taken away must have been added. Returns the work, in blocks touched; kNoRoom, and
  // nothing is changed, if less than `spare` blocks of the store might be left.
  static constexpr std::int64_t kNoRoom = -1;
  std::int64_t update(double sign, const Block& b, int pose_a, int pose_b, std::int64_t spare = 0);
  // L L^T x = right, both by pose, six numbers each. Parts that contribute
  // less than `least` to right^T x are left out (0: none), and are exactly
  // zero in x, as are poses that the factor does not have. Returns the work.
  std::int64_t solve(const double* right, double* x, double least);
  // Columns of the inverse: with Z = L^-1 [E_a E_b], the 12 x 12 Z^T Z, column by column (pose_b < 0: 6 x 6).
  void covariance(int pose_a, int pose_b, double* result);

  // To fill a cleared factor column by column, in rising position.
  void startColumns(std::span<const int> poses);  // all poses, in order of elimination; diagonals zero
  Block& diagonal(int position) { return diagonal_[at(position)]; }
  // Gives the column its rows (rising), blocks zero. There must be room.
  void makeColumn(int position, std::span<const int> rows);
  Block* columnBlocks(int position) { return blocks_.data() + first_[at(position)]; }
  const int* columnRows(int position) const { return rows_.data() + first_[at(position)]; }
  int columnCount(int position) const { return count_[at(position)]; }

  int size() const { return size_; }  // positions in use
  bool has(int pose) const { return positionOf(pose) >= 0; }
  int positionOf(int pose) const { return position_of_[at(pose)]; }  // -1: none
  int poseAt(int position) const { return pose_at_[at(position)]; }  // -1: buried
  std::int64_t blocksInUse() const { return in_use_; }
  std::int64_t storeUsed() const { return used_; }  // blocks, with what moved columns left behind

 private:
  std::int64_t alongPaths(int pose_a, int pose_b, auto visit);
  std::int64_t growth(int position, int rows) const;
  void place(int position, int row, int rows);
  void pack();
  int forwardPath(int pose, std::span<Block> z);

  const ColumnKernels* kernels_ = &fastestColumnKernels();
  std::span<Block> blocks_;        // all columns
  std::span<int> rows_;            // their positions
  std::span<Block> diagonal_;      // by position
  std::span<std::int64_t> first_;  // of a column's blocks
  std::span<int> count_, capacity_;
  std::span<int> position_of_, pose_at_;
  Work work_;
  int size_ = 0;
  std::int64_t used_ = 0, in_use_ = 0;
};

}  // namespace fathom::slam
