#include "recon/solver/batch/block_cholesky.hpp"

#include <suitesparse/cholmod.h>

#include <algorithm>
#include <stdexcept>

#include "recon/solver/block_kernels.hpp"

namespace fathom::slam {

// A pattern of one number a block, lower part, columns sorted.
struct BlockPattern {
  std::vector<int> start, row;
};

namespace {

BlockPattern patternOf(int blocks, std::span<const BlockCholesky::Pair> pairs) {
  std::vector<std::array<int, 2>> entries;  // column, row
  entries.reserve(at(blocks) + pairs.size());
  for (int i = 0; i < blocks; ++i) entries.push_back({i, i});
  for (const auto& [a, b] : pairs) entries.push_back({std::min(a, b), std::max(a, b)});
  std::sort(entries.begin(), entries.end());
  entries.erase(std::unique(entries.begin(), entries.end()), entries.end());
  BlockPattern p;
  p.start.assign(at(blocks) + 1, 0);
  for (const auto& [column, row] : entries) {
    ++p.start[at(column) + 1];
    p.row.push_back(row);
  }
  for (int i = 0; i < blocks; ++i) p.start[at(i) + 1] += p.start[at(i)];
  return p;
}

// A symmetric matrix, or its pattern without values: of blocks on the diagonal only the lower part is read.
cholmod_sparse lowerPart(std::vector<int>& start, std::vector<int>& row, double* values) {
  cholmod_sparse m{};
  m.nrow = m.ncol = start.size() - 1;
  m.nzmax = row.size();
  m.p = start.data();
  m.i = row.data();
  m.x = values;
  m.stype = -1;
  m.itype = CHOLMOD_INT;
  m.xtype = values == nullptr ? CHOLMOD_PATTERN : CHOLMOD_REAL;
  m.dtype = CHOLMOD_DOUBLE;
  m.sorted = m.packed = 1;
  return m;
}

}  // namespace

struct BlockCholesky::Impl {
  int blocks, size;
  cholmod_common common{};
  BlockPattern pattern;
  std::vector<int> start, row;  // of the numbers
  std::vector<double> value;
  std::vector<int> slot;  // of each pair: which block of its column
  std::vector<Pair> pairs;
  std::vector<int> place;         // of each number in the order of elimination
  std::vector<int> supernode_of;  // of each place
  cholmod_sparse matrix{};
  cholmod_factor* factor = nullptr;

  [[nodiscard]] double* numbers(int column_block, int block_in_column) {
    return &value[at(start[at(column_block * size)] + block_in_column * size)];
  }
  [[nodiscard]] int columnStride(int column_block) const {
    return (pattern.start[at(column_block) + 1] - pattern.start[at(column_block)]) * size;
  }
  std::vector<int> order(Order wanted);
  void add(int column_block, int block_in_column, const Eigen::Ref<const Eigen::MatrixXd>& m,
           bool transposed);
  void add6(int column_block, int block_in_column, const Eigen::Matrix<double, 6, 6>& m) {
    double* block = numbers(column_block, block_in_column);
    const int stride = columnStride(column_block);
    for (int c = 0; c < 6; ++c)
      for (int r = 0; r < 6; ++r) block[c * stride + r] += m(r, c);
  }
};

// Elimination order of the blocks by METIS; or by AMD, or the better of both as CHOLMOD counts their factors.
std::vector<int> BlockCholesky::Impl::order(Order wanted) {
  cholmod_sparse graph = lowerPart(pattern.start, pattern.row, nullptr);
  // For small graphs nested dissection takes longer than it saves.
  constexpr int kSmall = 5000;
  const bool sparsest = wanted == Order::kSparsest;
  common.nmethods = sparsest && blocks >= kSmall ? 2 : 1;
  common.method[0].ordering = sparsest ? CHOLMOD_AMD : CHOLMOD_METIS;
  common.method[1].ordering = CHOLMOD_METIS;
  cholmod_factor* analysis = cholmod_analyze(&graph, &common);
  if (analysis == nullptr) throw std::runtime_error("CHOLMOD cannot analyse the pattern: out of memory");
  const int* permutation = static_cast<const int*>(analysis->Perm);
  std::vector<int> result(permutation, permutation + blocks);
  cholmod_free_factor(&analysis, &common);
  return result;
}

BlockCholesky::BlockCholesky(int blocks, int size, std::span<const Pair> pairs, Order order)
    : impl_(std::make_unique<Impl>()) {
  Impl& m = *impl_;
  m.blocks = blocks;
  m.size = size;
  m.pattern = patternOf(blocks, pairs);
  m.pairs.assign(pairs.begin(), pairs.end());
  cholmod_start(&m.common);
  m.common.print = 0;
  m.common.supernodal = CHOLMOD_SUPERNODAL;

  for (const auto& [a, b] : pairs) {
    const auto first = m.pattern.row.begin() + m.pattern.start[at(std::min(a, b))];
    const auto last = m.pattern.row.begin() + m.pattern.start[at(std::min(a, b)) + 1];
    m.slot.push_back(static_cast<int>(std::lower_bound(first, last, std::max(a, b)) - first));
  }
  m.start.reserve(at(blocks * size) + 1);
  m.start.push_back(0);
  for (int j = 0; j < blocks; ++j) {
    for (int c = 0; c < size; ++c) {
      for (int k = m.pattern.start[at(j)]; k < m.pattern.start[at(j) + 1]; ++k)
        for (int r = 0; r < size; ++r) m.row.push_back(m.pattern.row[at(k)] * size + r);
      m.start.push_back(static_cast<int>(m.row.size()));
    }
  }
  m.value.assign(m.row.size(), 0.0);
  m.matrix = lowerPart(m.start, m.row, m.value.data());

  std::vector<int> permutation;
  for (const int block : m.order(order))
    for (int r = 0; r < size; ++r) permutation.push_back(block * size + r);
  m.common.nmethods = 1;
  m.common.method[0].ordering = CHOLMOD_GIVEN;
  m.factor = cholmod_analyze_p(&m.matrix, permutation.data(), nullptr, 0, &m.common);
  if (m.factor == nullptr) throw std::runtime_error("CHOLMOD cannot analyse the matrix: out of memory");
  const int* eliminated = static_cast<const int*>(m.factor->Perm);
  m.place.resize(at(dimension()));
  for (int k = 0; k < dimension(); ++k) m.place[at(eliminated[k])] = k;
  const int* first = static_cast<const int*>(m.factor->super);
  for (int s = 0; s < static_cast<int>(m.factor->nsuper); ++s) m.supernode_of.resize(at(first[s + 1]), s);
}

BlockCholesky::~BlockCholesky() {
  cholmod_free_factor(&impl_->factor, &impl_->common);
  cholmod_finish(&impl_->common);
}

void BlockCholesky::setZero() {
  std::fill(impl_->value.begin(), impl_->value.end(), 0.0);
}

void BlockCholesky::Impl::add(int column_block, int block_in_column,
                              const Eigen::Ref<const Eigen::MatrixXd>& m, bool transposed) {
  Eigen::Map<Eigen::MatrixXd, 0, Eigen::OuterStride<>> block(
      numbers(column_block, block_in_column), size, size, Eigen::OuterStride<>(columnStride(column_block)));
  if (transposed)
    block += m.transpose();
  else
    block += m;
}

void BlockCholesky::addDiagonal(int block, const Eigen::Ref<const Eigen::MatrixXd>& values) {
  impl_->add(block, 0, values, false);
}

void BlockCholesky::addPair(std::size_t k, const Eigen::Ref<const Eigen::MatrixXd>& values) {
  const auto& [row, column] = impl_->pairs[k];
  impl_->add(std::min(row, column), impl_->slot[k], values, row < column);
}

void BlockCholesky::addDiagonal6(int block, const Eigen::Matrix<double, 6, 6>& values) {
  impl_->add6(block, 0, values);
}

void BlockCholesky::addPair6(std::size_t k, const Eigen::Matrix<double, 6, 6>& values) {
  const auto& [row, column] = impl_->pairs[k];
  if (row < column)
    impl_->add6(row, impl_->slot[k], values.transpose());
  else
    impl_->add6(column, impl_->slot[k], values);
}

bool BlockCholesky::factorize(double damping) {
  Impl& m = *impl_;
  std::vector<double> diagonal;
  const auto entry = [&](int i) -> double& {
    return m.numbers(i / m.size, 0)[i % m.size * (m.columnStride(i / m.size) + 1)];
  };
  for (int i = 0; i < dimension(); ++i) {
    diagonal.push_back(entry(i));
    entry(i) *= 1 + damping;
  }
  const int done = cholmod_factorize(&m.matrix, m.factor, &m.common);
  for (int i = 0; i < dimension(); ++i) entry(i) = diagonal[at(i)];
  return done != 0 && m.common.status == CHOLMOD_OK;
}

Eigen::MatrixXd BlockCholesky::solve(const Eigen::Ref<const Eigen::MatrixXd>& right) const {
  Impl& m = *impl_;
  Eigen::MatrixXd copy = right;
  cholmod_dense b{};
  b.nrow = static_cast<std::size_t>(copy.rows());
  b.ncol = static_cast<std::size_t>(copy.cols());
  b.nzmax = b.nrow * b.ncol;
  b.d = b.nrow;
  b.x = copy.data();
  b.xtype = CHOLMOD_REAL;
  b.dtype = CHOLMOD_DOUBLE;
  cholmod_dense* x = cholmod_solve(CHOLMOD_A, m.factor, &b, &m.common);
  if (x == nullptr) throw std::runtime_error("CHOLMOD cannot solve: out of memory");
  Eigen::MatrixXd result =
      Eigen::Map<const Eigen::MatrixXd>(static_cast<const double*>(x->x), copy.rows(), copy.cols());
  cholmod_free_dense(&x, &m.common);
  return result;
}

// Column by column of supernodes: solve its own rows, take their share from those above.
BlockCholesky::TreePath BlockCholesky::pathOf(int block,
                                              const Eigen::Ref<const Eigen::MatrixXd>& right) const {
  using Strided = Eigen::Map<const Eigen::MatrixXd, 0, Eigen::OuterStride<>>;
  const Impl& m = *impl_;
  const int* first = static_cast<const int*>(m.factor->super);
  const int* row_start = static_cast<const int*>(m.factor->pi);
  const int* value_start = static_cast<const int*>(m.factor->px);
  const int* rows = static_cast<const int*>(m.factor->s);
  const double* values = static_cast<const double*>(m.factor->x);
  const auto width = [&](int s) { return first[s + 1] - first[s]; };
  const auto height = [&](int s) { return row_start[s + 1] - row_start[s]; };

  TreePath path;
  int count = 0;
  for (int s = m.supernode_of[at(m.place[at(block * m.size)])];;) {
    path.part.push_back(s);
    path.row.push_back(count);
    count += width(s);
    if (height(s) == width(s)) break;
    s = m.supernode_of[at(rows[row_start[s] + width(s)])];
  }
  path.row.push_back(count);
  path.value = Eigen::MatrixXd::Zero(count, right.cols());
  for (int r = 0; r < m.size; ++r)
    path.value.row(m.place[at(block * m.size + r)] - first[path.part.front()]) = right.row(r);
  Eigen::MatrixXd share;
  for (std::size_t p = 0; p < path.part.size(); ++p) {
    const int s = path.part[p], own = width(s), below = height(s) - own;
    const Strided columns(values + value_start[s], height(s), own, Eigen::OuterStride<>(height(s)));
    auto here = path.value.middleRows(path.row[p], own);
    columns.topRows(own).triangularView<Eigen::Lower>().solveInPlace(here);
    if (below == 0) continue;
    share.noalias() = columns.bottomRows(below) * here;
    std::size_t above = p + 1;
    for (int k = 0; k < below; ++k) {
      const int row = rows[row_start[s] + own + k];
      while (row >= first[path.part[above] + 1]) ++above;
      path.value.row(path.row[above] + row - first[path.part[above]]) -= share.row(k);
    }
  }
  return path;
}

Eigen::MatrixXd BlockCholesky::squaredDifference(const TreePath& a, const TreePath& b) {
  const Eigen::Index columns = a.part.empty() ? b.value.cols() : a.value.cols();
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(columns, columns), difference;
  const auto part = [](const TreePath& path, std::size_t p) {
    return path.value.middleRows(path.row[p], path.row[p + 1] - path.row[p]);
  };
  std::size_t i = 0, j = 0;
  while (i < a.part.size() || j < b.part.size()) {
    if (j == b.part.size() || (i < a.part.size() && a.part[i] < b.part[j]))
      difference = part(a, i++);
    else if (i == a.part.size() || b.part[j] < a.part[i])
      difference = part(b, j++);
    else
      difference = part(b, j++) - part(a, i++);
    sum.noalias() += difference.transpose() * difference;
  }
  return sum;
}

int BlockCholesky::dimension() const {
  return impl_->blocks * impl_->size;
}

double BlockCholesky::factorEntries() const {
  return impl_->common.lnz;
}

std::size_t BlockCholesky::memoryBytes() const {
  return impl_->common.memory_usage;
}

}  // namespace fathom::slam
