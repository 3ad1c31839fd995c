#include "recon/solver/incremental/growing_factor.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

namespace fathom::slam {
namespace {

// Work of a column apart from its blocks, and blocks of a solution that cost as much as a product.
constexpr int kColumnWork = 8, kSolvedPerWork = 2;
constexpr int kLeastColumnGrowth = 8;  // rows that a column which moves has spare, at least
constexpr int kWorthPacking = 8;       // part of the store that packing must free

double square(const double* x) {
  double sum = 0;
  for (int i = 0; i < kBlockSize; ++i) sum += x[i] * x[i];
  return sum;
}

}  // namespace

GrowingFactor::Work::Work(const Size& size, rt::Arena& arena) {
  const auto positions = at(size.positions);
  blocks = arena.allocateArray<Block>(2 * positions);
  pattern = arena.allocateArray<int>(positions);
  added = arena.allocateArray<int>(positions);
  mark = arena.allocateArray<int>(positions);
  vector = arena.allocateArray<double>(kBlockSize * positions);
  reached = arena.allocateArray<std::uint8_t>(positions);
  std::fill(mark.begin(), mark.end(), -1);
}

std::size_t GrowingFactor::Work::bytes(const Size& size) {
  constexpr std::size_t kArrays = 6, kAlignment = alignof(Block);
  return at(size.positions) *
             (2 * sizeof(Block) + 3 * sizeof(int) + kBlockSize * sizeof(double) + sizeof(std::uint8_t)) +
         kArrays * kAlignment;
}

GrowingFactor::GrowingFactor(const Size& size, rt::Arena& arena, const Work& work) : work_(work) {
  const auto poses = at(size.positions);
  blocks_ = arena.allocateArray<Block>(at(size.blocks));
  rows_ = arena.allocateArray<int>(at(size.blocks));
  diagonal_ = arena.allocateArray<Block>(poses);
  first_ = arena.allocateArray<std::int64_t>(poses);
  count_ = arena.allocateArray<int>(poses);
  capacity_ = arena.allocateArray<int>(poses);
  position_of_ = arena.allocateArray<int>(at(size.poses));
  pose_at_ = arena.allocateArray<int>(poses);
  clear();
}

std::size_t GrowingFactor::bytesBesideWork(const Size& size) {
  constexpr std::size_t kArrays = 8, kAlignment = alignof(Block);
  return at(size.blocks) * (sizeof(Block) + sizeof(int)) +
         at(size.positions) * (sizeof(Block) + sizeof(std::int64_t) + 3 * sizeof(int)) +
         at(size.poses) * sizeof(int) + kArrays * kAlignment;
}

void GrowingFactor::clear() {
  std::fill(position_of_.begin(), position_of_.end(), -1);
  size_ = 0;
  used_ = in_use_ = 0;
}

bool GrowingFactor::append(int pose) {
  if (at(size_) >= diagonal_.size()) return false;
  const int position = size_++;
  position_of_[at(pose)] = position;
  pose_at_[at(position)] = pose;
  first_[at(position)] = used_;
  count_[at(position)] = capacity_[at(position)] = 0;
  Block& d = diagonal_[at(position)];
  std::memset(d.v, 0, sizeof d.v);
  for (int i = 0; i < kBlockSize; ++i) d(i, i) = std::sqrt(kLeastInformation);
  return true;
}

void GrowingFactor::removePose(int position) {
  const int pose = pose_at_[at(position)];
  if (pose >= 0 && position_of_[at(pose)] == position) position_of_[at(pose)] = -1;
  pose_at_[at(position)] = -1;
}

// Blocks of the store that a column takes to have so many more rows.
std::int64_t GrowingFactor::growth(int position, int rows) const {
  const int count = count_[at(position)];
  return count + rows <= capacity_[at(position)] ? 0
                                                 : count + std::max({rows, kLeastColumnGrowth, count / 4});
}

// Puts one of `rows` new rows into a column; there is room.
void GrowingFactor::place(int position, int row, int rows) {
  std::int64_t& first = first_[at(position)];
  int& count = count_[at(position)];
  if (const std::int64_t wanted = growth(position, rows); wanted > 0) {
    if (first + capacity_[at(position)] != used_) {  // the last column grows where it is
      std::memcpy(&blocks_[at(used_)], &blocks_[at(first)], at(count) * sizeof(Block));
      std::memcpy(&rows_[at(used_)], &rows_[at(first)], at(count) * sizeof(int));
      first = used_;
    }
    used_ = first + wanted;
    capacity_[at(position)] = static_cast<int>(wanted);
  }
  rows_[at(first + count)] = row;
  std::memset(blocks_[at(first + count)].v, 0, sizeof(Block));
  ++count;
  ++in_use_;
}

// Moves columns together, over what moved ones left behind and what they have spare.
void GrowingFactor::pack() {
  const std::span<int> order = work_.pattern.first(at(size_));
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return first_[at(a)] < first_[at(b)]; });
  used_ = 0;
  for (const int position : order) {
    const std::int64_t from = std::exchange(first_[at(position)], used_);
    const int count = capacity_[at(position)] = count_[at(position)];
    if (count == 0) continue;
    std::memmove(&blocks_[at(used_)], &blocks_[at(from)], at(count) * sizeof(Block));
    std::memmove(&rows_[at(used_)], &rows_[at(from)], at(count) * sizeof(int));
    used_ += count;
  }
}

// Calls visit(column, rows) for the columns on the paths of two poses to the root, in order of elimination;
// `rows`: positions that the column lacks. Returns the work.
std::int64_t GrowingFactor::alongPaths(int pose_a, int pose_b, auto visit) {
  int reached = 0;
  const auto reach = [&](int position) {
    work_.pattern[at(reached++)] = position;
    work_.mark[at(position)] = 1;
  };
  reach(positionOf(pose_a));
  if (pose_b >= 0) reach(positionOf(pose_b));
  std::int64_t work = 0;
  while (reached > 0) {
    int least = 0;
    for (int i = 1; i < reached; ++i)
      if (work_.pattern[at(i)] < work_.pattern[at(least)]) least = i;
    const int column = work_.pattern[at(least)];
    work_.pattern[at(least)] = work_.pattern[at(--reached)];
    work_.mark[at(column)] = -1;
    const int* rows = columnRows(column);
    for (int k = 0; k < count_[at(column)]; ++k) {
      if (work_.mark[at(rows[k])] < 0) reach(rows[k]);
      work_.mark[at(rows[k])] = 2;  // in this column
    }
    std::size_t added = 0;
    for (int i = 0; i < reached; ++i) {
      const int row = work_.pattern[at(i)];
      if (work_.mark[at(row)] == 1) work_.added[added++] = row;
      work_.mark[at(row)] = 1;
    }
    visit(column, work_.added.first(added));
    work += reached + kColumnWork;
  }
  return work;
}

std::int64_t GrowingFactor::update(double sign, const Block& b, int pose_a, int pose_b, std::int64_t spare) {
  const auto store = static_cast<std::int64_t>(blocks_.size());
  const auto fits = [&] {
    std::int64_t needed = 0;
    alongPaths(pose_a, pose_b, [&](int column, std::span<const int> rows) {
      needed += growth(column, static_cast<int>(rows.size()));
    });
    return needed == 0 || used_ + needed + spare <= store;
  };
  std::int64_t packed = 0;
  if (!fits()) {
    if (used_ - in_use_ < store / kWorthPacking) return kNoRoom;
    pack();
    packed = in_use_;
    if (!fits()) return kNoRoom;
  }
  const auto start = [&](int pose, double factor) {
    Block& w = work_.blocks[at(positionOf(pose))];
    for (int c = 0; c < kBlockSize; ++c)
      for (int r = 0; r < kBlockSize; ++r) w(r, c) = factor * b(c, r);
  };
  start(pose_a, 1);
  if (pose_b >= 0) start(pose_b, -1);
  Reflections reflections;
  const std::int64_t work = alongPaths(pose_a, pose_b, [&](int column, std::span<const int> rows) {
    reflect(diagonal_[at(column)], work_.blocks[at(column)], sign, reflections);
    std::memset(work_.blocks[at(column)].v, 0, sizeof(Block));
    for (std::size_t i = 0; i < rows.size(); ++i) place(column, rows[i], static_cast<int>(rows.size() - i));
    kernels_->applyReflections(columnBlocks(column), columnRows(column), count_[at(column)], reflections,
                               work_.blocks.data());
  });
  return packed + work;
}

std::int64_t GrowingFactor::solve(const double* right, double* x, double least) {
  std::int64_t touched = 0;
  double* y = work_.vector.data();
  for (int j = 0; j < size_; ++j) {
    if (pose_at_[at(j)] < 0)
      std::memset(y + kBlockSize * j, 0, kBlockSize * sizeof(double));
    else
      std::memcpy(y + kBlockSize * j, right + kBlockSize * pose_at_[at(j)], kBlockSize * sizeof(double));
  }
  std::memset(x, 0, position_of_.size() * kBlockSize * sizeof(double));
  for (int j = 0; j < size_; ++j) {
    double* yj = y + kBlockSize * j;
    if (square(yj) == 0) continue;
    solveLower(diagonal_[at(j)], yj);
    if (square(yj) <= least) {
      std::memset(yj, 0, kBlockSize * sizeof(double));
      continue;
    }
    kernels_->forward(columnBlocks(j), columnRows(j), count_[at(j)], yj, y);
    touched += count_[at(j)];
  }
  for (int j = size_ - 1; j >= 0; --j) {
    double* yj = y + kBlockSize * j;
    const int* row = columnRows(j);
    const int count = count_[at(j)];
    bool moved = square(yj) > 0;
    for (int k = 0; k < count && !moved; ++k) moved = work_.reached[at(row[k])] != 0;
    if (moved) {
      kernels_->backward(columnBlocks(j), row, count, y, yj);
      touched += count;
      moved = square(yj) > least;
    }
    work_.reached[at(j)] = moved;
    if (moved)
      solveLowerTransposed(diagonal_[at(j)], yj);
    else
      std::memset(yj, 0, kBlockSize * sizeof(double));
    if (pose_at_[at(j)] >= 0) std::memcpy(x + kBlockSize * pose_at_[at(j)], yj, kBlockSize * sizeof(double));
  }
  return touched / kSolvedPerWork + size_;
}

// Z = L^-1 E of one pose, on its path to the root; `z` is zero before. Leaves work_.mark of the path at 1.
int GrowingFactor::forwardPath(int pose, std::span<Block> z) {
  int last = positionOf(pose);
  Block& start = z[at(last)];
  for (int i = 0; i < kBlockSize; ++i) start(i, i) = 1;
  work_.mark[at(last)] = 1;
  for (int j = last; j < size_; ++j) {
    if (work_.mark[at(j)] < 0) continue;
    for (int c = 0; c < kBlockSize; ++c) solveLower(diagonal_[at(j)], z[at(j)].v + kBlockSize * c);
    const int* row = columnRows(j);
    for (int k = 0; k < count_[at(j)]; ++k) work_.mark[at(row[k])] = 1;
    kernels_->forwardSix(columnBlocks(j), row, count_[at(j)], z[at(j)], z.data());
    last = j;
  }
  return last;
}

void GrowingFactor::covariance(int pose_a, int pose_b, double* result) {
  const std::size_t poses = diagonal_.size();
  const std::span<Block> za = work_.blocks.subspan(0, poses), zb = work_.blocks.subspan(poses, poses);
  forwardPath(pose_a, za);
  if (pose_b >= 0) forwardPath(pose_b, zb);
  const int n = pose_b >= 0 ? 2 * kBlockSize : kBlockSize;
  Block aa{}, ab{}, bb{};
  for (int j = 0; j < size_; ++j) {
    if (work_.mark[at(j)] < 0) continue;
    addTransposedProduct(aa, za[at(j)], za[at(j)]);
    if (pose_b >= 0) {
      addTransposedProduct(ab, za[at(j)], zb[at(j)]);
      addTransposedProduct(bb, zb[at(j)], zb[at(j)]);
    }
    za[at(j)] = zb[at(j)] = Block{};
    work_.mark[at(j)] = -1;
  }
  for (int c = 0; c < kBlockSize; ++c) {
    for (int r = 0; r < kBlockSize; ++r) {
      result[c * n + r] = aa(r, c);
      if (pose_b < 0) continue;
      result[(c + kBlockSize) * n + r] = ab(r, c);
      result[c * n + r + kBlockSize] = ab(c, r);
      result[(c + kBlockSize) * n + r + kBlockSize] = bb(r, c);
    }
  }
}

void GrowingFactor::startColumns(std::span<const int> poses) {
  clear();
  for (const int pose : poses) {
    append(pose);
    std::memset(diagonal_[at(size_ - 1)].v, 0, sizeof(Block));
  }
}

void GrowingFactor::makeColumn(int position, std::span<const int> rows) {
  const int count = static_cast<int>(rows.size());
  first_[at(position)] = used_;
  count_[at(position)] = count;
  capacity_[at(position)] = count;
  if (count > 0) {
    std::copy(rows.begin(), rows.end(), rows_.data() + used_);
    std::memset(static_cast<void*>(blocks_.data() + used_), 0, at(count) * sizeof(Block));
  }
  used_ += capacity_[at(position)];
  in_use_ += count;
}

}  // namespace fathom::slam
