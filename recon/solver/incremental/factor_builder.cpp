#include "recon/solver/incremental/factor_builder.hpp"

#include <suitesparse/camd.h>

#include <algorithm>

namespace fathom::slam {
namespace {

constexpr std::int64_t kLinearizeWork = 8;  // of one measurement, in block operations
constexpr std::int64_t kOrderWork = 12;     // of a pose or measurement that is ordered
constexpr std::int64_t kCountedPerWork = 8;

}  // namespace

FactorBuilder::FactorBuilder(const Size& size, rt::Arena& arena) {
  const auto poses = at(size.poses), edges = at(size.measurements);
  links_ = arena.allocateArray<Link>(edges);
  first_ = arena.allocateArray<int>(poses);
  kept_ = arena.allocateArray<Measurement>(at(size.kept));
  at_poses_ = arena.allocateArray<SE3>(poses);
  fixed_ = arena.allocateArray<std::uint8_t>(poses);
  order_ = arena.allocateArray<int>(poses);
  ordering_ = arena.allocateArray<int>(12 * (poses + 1) + 3 * edges);
  for (std::span<int>* s : {&head_, &link_, &cursor_, &first_child_, &next_sibling_, &place_, &pattern_})
    *s = arena.allocateArray<int>(poses);
  std::fill(place_.begin(), place_.end(), -1);
}

std::size_t FactorBuilder::bytes(const Size& size) {
  constexpr std::size_t kArrays = 14, kAlignment = alignof(Block);
  const auto poses = at(size.poses), edges = at(size.measurements);
  return edges * sizeof(Link) + at(size.kept) * sizeof(Measurement) +
         poses * (sizeof(SE3) + sizeof(std::uint8_t)) +
         sizeof(int) * (12 * (poses + 1) + 3 * edges + 9 * poses) + kArrays * kAlignment;
}

void FactorBuilder::order(std::span<const std::uint8_t> newest) {
  const auto n = at(poses_);
  int* free = ordering_.data();
  const auto take = [&](std::size_t count) {
    int* array = free;
    free += count;
    return array;
  };
  int* start = take(n + 1);
  int* length = take(n + 1);
  int* nv = take(n + 1);
  int* forward = take(n + 1);
  int* head = take(n + 1);
  int* element = take(n + 1);
  int* degree = take(n + 1);
  int* w = take(n + 1);
  int* constraint = take(n + 1);
  int* bucket = take(n + 1);
  int* entries = free;
  const int room = static_cast<int>(ordering_.data() + ordering_.size() - free);

  int used = 0;
  for (int i = 0; i < poses_; ++i) {
    start[i] = used;
    for (int k = first(i); k >= 0; k = next(k, i)) {
      const Link& m = links_[at(k)];
      const int other = otherEnd(k, i);
      if (m.from == kWorld || m.weight == 0 || fixed_[at(i)] || fixed_[at(other)] || place_[at(other)] == i)
        continue;
      place_[at(other)] = i;
      entries[used++] = other;
    }
    length[i] = used - start[i];
    constraint[i] = newest[at(i)];
  }
  std::fill(place_.begin(), place_.end(), -1);
  double control[CAMD_CONTROL], info[CAMD_INFO];
  camd_defaults(control);
  camd_2(poses_, start, entries, length, room, used, nv, forward, order_.data(), head, element, degree, w,
         control, info, constraint, bucket);
}

// Whether a measurement joins two poses that are solved for.
bool FactorBuilder::counts(int k) const {
  const Link& m = links_[at(k)];
  return m.from != kWorld && m.weight > 0 && !fixed_[at(m.from)] && !fixed_[at(m.to)];
}

// Blocks below the diagonal, row by row: from each earlier neighbour up the elimination tree (Liu 1990), to
// where the row has been met.
void FactorBuilder::count() {
  const std::span<int> position = link_, parent = first_child_, met = cursor_;
  for (int j = 0; j < poses_; ++j) {
    position[at(order_[at(j)])] = j;
    parent[at(j)] = met[at(j)] = -1;
  }
  blocks_ = 0;
  for (int i = 0; i < poses_; ++i) {
    const int pose = order_[at(i)];
    met[at(i)] = i;
    for (int k = first(pose); k >= 0; k = next(k, pose)) {
      if (!counts(k)) continue;
      int j = position[at(otherEnd(k, pose))];
      for (; j < i && met[at(j)] != i; j = parent[at(j)]) {
        met[at(j)] = i;
        ++blocks_;
        if (parent[at(j)] < 0) parent[at(j)] = i;
      }
    }
  }
}

std::int64_t FactorBuilder::begin(std::span<const SE3> poses, std::span<const std::uint8_t> held,
                                  std::span<const std::uint8_t> newest,
                                  std::span<const std::uint8_t> left_out, const Measurements& measurements,
                                  double damping, GrowingFactor& factor) {
  poses_ = static_cast<int>(poses.size());
  measurements_ = &measurements;
  links_count_ = measurements.size();
  kept_count_ = 0;
  for (int k = 0; k < links_count_; ++k) {
    const Measurement& m = measurements[k];
    const bool taken = m.in_use && left_out[at(k)] == 0;
    links_[at(k)] = {m.from, m.to, {m.next[0], m.next[1]}, taken ? m.weight : 0, -1};
  }
  for (int i = 0; i < poses_; ++i) first_[at(i)] = measurements.first(i);
  next_ = 0;
  damping_ = damping;
  std::copy(poses.begin(), poses.end(), at_poses_.begin());
  std::copy(held.begin(), held.end(), fixed_.begin());
  order(newest);
  count();
  factor.startColumns(order_.subspan(0, at(poses_)));
  for (int j = 0; j < poses_; ++j)
    head_[at(j)] = link_[at(j)] = first_child_[at(j)] = next_sibling_[at(j)] = -1;
  return kOrderWork * (poses_ + measurements.count()) + blocks_ / kCountedPerWork;
}

bool FactorBuilder::keep(int k) {
  if (!running() || k >= links_count_) return true;
  Link& link = links_[at(k)];
  if (link.weight == 0 || link.kept >= 0) return true;
  if (at(kept_count_) == kept_.size()) return false;
  link.kept = kept_count_++;
  kept_[at(link.kept)] = (*measurements_)[k];
  return true;
}

// Rows of a column below its diagonal, and their places: neighbours that come later, and rows of the columns
// below it in the elimination tree. Returns their number.
int FactorBuilder::findRows(int j, GrowingFactor& factor) {
  const int pose = factor.poseAt(j);
  int count = 0;
  const auto add = [&](int row) {
    if (place_[at(row)] >= 0) return;
    place_[at(row)] = 1;
    pattern_[at(count++)] = row;
  };
  if (!fixed_[at(pose)]) {
    for (int k = first(pose); k >= 0; k = next(k, pose)) {
      const int other = otherEnd(k, pose);
      if (links_[at(k)].weight > 0 && other != kWorld && !fixed_[at(other)] && factor.positionOf(other) > j)
        add(factor.positionOf(other));
    }
  }
  for (int c = first_child_[at(j)]; c >= 0; c = next_sibling_[at(c)]) {
    const int* rows = factor.columnRows(c);
    for (int k = 0; k < factor.columnCount(c); ++k)
      if (rows[k] != j) add(rows[k]);
  }
  std::sort(pattern_.begin(), pattern_.begin() + count);
  for (int k = 0; k < count; ++k) place_[at(pattern_[at(k)])] = k;
  return count;
}

// Adds the measurements of a column's pose that no earlier column has; returns the work.
std::int64_t FactorBuilder::addMeasurements(int j, GrowingFactor& factor, std::span<InFactor> then) {
  const int pose = factor.poseAt(j);
  std::int64_t work = 0;
  Block& diagonal = factor.diagonal(j);
  for (int i = 0; i < kBlockSize; ++i)
    diagonal(i, i) += fixed_[at(pose)] ? 1 : GrowingFactor::kLeastInformation;
  for (int k = first(pose); k >= 0 && !fixed_[at(pose)]; k = next(k, pose)) {
    const Link& m = links_[at(k)];
    if (!(m.weight > 0)) {
      then[at(k)].weight = 0;
      continue;
    }
    const int other = otherEnd(k, pose);
    const bool free_end = other != kWorld && !fixed_[at(other)];
    if (free_end && factor.positionOf(other) < j) continue;  // added with that column
    then[at(k)] = {m.from == kWorld ? SE3() : at_poses_[at(m.from)], at_poses_[at(m.to)], m.weight};
    const Block b = worldDerivative(measurement(k), then[at(k)]);
    Block square{};
    addTransposedProduct(square, b, b);
    addBlock(diagonal, square, 1);
    if (free_end) {
      const int position = factor.positionOf(other);
      addBlock(factor.diagonal(position), square, 1);
      addBlock(factor.columnBlocks(j)[place_[at(position)]], square, -1);
    }
    work += kLinearizeWork;
  }
  return work;
}

// Subtracts the products of the columns that have their next row here; returns the work.
std::int64_t FactorBuilder::subtractColumns(int j, GrowingFactor& factor) {
  std::int64_t work = 0;
  for (int d = head_[at(j)]; d >= 0;) {
    const int next_column = link_[at(d)];
    const int* rows = factor.columnRows(d);
    const Block* from = factor.columnBlocks(d);
    const int size = factor.columnCount(d);
    int k = cursor_[at(d)];
    const Block& mine = from[k];
    constexpr int kFirst = 0;
    kernels_->subtractProducts(&mine, &kFirst, 1, mine, &kFirst, &factor.diagonal(j));
    work += size - k;
    cursor_[at(d)] = ++k;
    if (k < size) {
      link_[at(d)] = head_[at(rows[k])];
      head_[at(rows[k])] = d;
    }
    kernels_->subtractProducts(from + k, rows + k, size - k, mine, place_.data(), factor.columnBlocks(j));
    d = next_column;
  }
  return work;
}

std::int64_t FactorBuilder::column(int j, GrowingFactor& factor, std::span<InFactor> then) {
  const int count = findRows(j, factor);
  factor.makeColumn(j, pattern_.subspan(0, at(count)));
  std::int64_t work = count + 1 + addMeasurements(j, factor, then);
  Block& diagonal = factor.diagonal(j);
  if (damping_ > 0)
    for (double& v : diagonal.v) v *= 1 + damping_;
  work += subtractColumns(j, factor);
  factorizeBlock(diagonal, GrowingFactor::kLeastInformation);
  kernels_->solveFromRight(factor.columnBlocks(j), count, diagonal);
  for (int k = 0; k < count; ++k) place_[at(pattern_[at(k)])] = -1;
  if (count > 0) {
    const int parent = pattern_[0];
    cursor_[at(j)] = 0;
    link_[at(j)] = head_[at(parent)];
    head_[at(parent)] = j;
    next_sibling_[at(j)] = first_child_[at(parent)];
    first_child_[at(parent)] = j;
  }
  return work;
}

std::int64_t FactorBuilder::run(std::int64_t quota, GrowingFactor& factor, std::span<InFactor> in_factor) {
  std::int64_t work = 0;
  while (running() && work < quota) work += column(next_++, factor, in_factor);
  return work;
}

}  // namespace fathom::slam
