#include "telemetry/map/map_kriging.hpp"

#include <algorithm>

namespace fathom::telemetry::packet {
namespace {

constexpr int kFraction = 16;  // bits of the fixed-point numbers below
constexpr std::int64_t kOne = std::int64_t{1} << kFraction;
constexpr std::int64_t kNoise = 19661;  // 0.3

// Largest r with r * r <= n.
constexpr std::int64_t squareRoot(std::int64_t n) {
  std::int64_t root = 0;
  for (std::int64_t bit = std::int64_t{1} << 31; bit > 0; bit >>= 1)
    if ((root + bit) * (root + bit) <= n) root += bit;
  return root;
}

// h^1.5 of h^2 = 0 to 512, the farthest that two candidates are apart.
constexpr std::array<std::int64_t, 513> kVariogram = [] {
  std::array<std::int64_t, 513> table{};
  for (std::size_t k = 0; k < table.size(); ++k) {
    const auto d2 = static_cast<std::int64_t>(k);
    table[k] = squareRoot(squareRoot(d2 * d2 * d2 << 2 * kFraction) << kFraction);
  }
  return table;
}();

std::array<Offset, kCandidates> makeCandidates(Shape shape) {
  constexpr int kReach = 4;
  std::vector<Offset> all;
  for (int north = -kReach; north <= kReach; ++north)
    for (int east = -kReach; east <= kReach; ++east)
      if ((north != 0 || east != 0) && (shape == Shape::kSquare || (north + east) % 2 == 0))
        all.push_back({north, east});
  std::stable_sort(all.begin(), all.end(), [](const Offset& a, const Offset& b) {
    return a.north * a.north + a.east * a.east < b.north * b.north + b.east * b.east;
  });
  std::array<Offset, kCandidates> nearest{};
  std::copy_n(all.begin(), kCandidates, nearest.begin());
  return nearest;
}

}  // namespace

const std::array<Offset, kCandidates>& candidates(Shape shape) {
  static const std::array<Offset, kCandidates> square = makeCandidates(Shape::kSquare);
  static const std::array<Offset, kCandidates> diagonal = makeCandidates(Shape::kDiagonal);
  return shape == Shape::kSquare ? square : diagonal;
}

std::int64_t variogram(std::int64_t squared_distance) {
  return kVariogram[static_cast<std::size_t>(squared_distance)];
}

KrigingWeights solveKriging(Shape shape, int stride, std::uint32_t used) {
  KrigingWeights out;
  out.used = used;
  for (std::size_t k = 0; k < kCandidates && out.count < static_cast<int>(kNeighbours); ++k)
    if ((used >> k & 1U) != 0)
      out.candidate[static_cast<std::size_t>(out.count++)] = static_cast<std::uint8_t>(k);
  const auto n = static_cast<std::size_t>(out.count);
  const auto& offsets = candidates(shape);
  const auto gamma = [&](const Offset& a, const Offset& b) {
    const std::int64_t north = a.north - b.north, east = a.east - b.east;
    return variogram((north * north + east * east) * stride * stride);
  };
  const auto at = [&](std::size_t k) { return offsets[out.candidate[k]]; };
  const Offset middle{0, 0};
  // Covariances of the differences to the nearest neighbour, L D L^T of them (L's unit diagonal left out),
  // and the solution by substitution.
  std::array<std::array<std::int64_t, kNeighbours>, kNeighbours> low{};
  std::array<std::int64_t, kNeighbours> diagonal{}, right{}, solution{};
  const std::int64_t to_middle = gamma(at(0), middle);
  for (std::size_t i = 1; i < n; ++i) {
    const std::int64_t to_first = gamma(at(i), at(0));
    right[i] = to_first + to_middle - gamma(at(i), middle) + kNoise;
    for (std::size_t j = 1; j <= i; ++j) {
      std::int64_t sum =
          to_first + gamma(at(j), at(0)) - gamma(at(i), at(j)) + kNoise + (i == j ? kNoise : 0);
      for (std::size_t k = 1; k < j; ++k)
        sum -= (low[i][k] * diagonal[k] >> kFraction) * low[j][k] >> kFraction;
      if (i == j)
        diagonal[i] = std::max<std::int64_t>(sum, 1);
      else
        low[i][j] = sum * kOne / diagonal[j];
    }
  }
  for (std::size_t i = 1; i < n; ++i) {
    solution[i] = right[i];
    for (std::size_t k = 1; k < i; ++k) solution[i] -= low[i][k] * solution[k] >> kFraction;
  }
  for (std::size_t i = 1; i < n; ++i) solution[i] = solution[i] * kOne / diagonal[i];
  std::int64_t variance = 2 * to_middle + kNoise;
  for (std::size_t i = n; i-- > 1;) {
    for (std::size_t k = i + 1; k < n; ++k) solution[i] -= low[k][i] * solution[k] >> kFraction;
    variance -= solution[i] * right[i] >> kFraction;
    out.weight[i] = static_cast<std::int32_t>((solution[i] + 2) >> (kFraction - kWeightBits));
  }
  out.weight[0] = 1 << kWeightBits;
  for (std::size_t i = 1; i < n; ++i) out.weight[0] -= out.weight[i];
  out.deviation = static_cast<std::int32_t>(squareRoot(std::max<std::int64_t>(variance, 1)));
  return out;
}

KrigingTable::KrigingTable() : slots_(kSlots), keys_(kSlots, 0) {
  (void)candidates(Shape::kSquare);  // computed on first use
}

const KrigingWeights& KrigingTable::weights(Shape shape, int stride, std::uint32_t used) {
  // 24 bits of pattern, two of stride (1, 2 or 4), one of shape; never 0, as at least one candidate is used.
  const std::uint32_t key = used | static_cast<std::uint32_t>(stride / 2) << kCandidates |
                            static_cast<std::uint32_t>(shape) << (kCandidates + 2);
  const std::size_t slot = (key * 2654435761U >> 16) % kSlots;  // Knuth's multiplicative hash
  if (keys_[slot] != key) {
    slots_[slot] = solveKriging(shape, stride, used);
    keys_[slot] = key;
  }
  return slots_[slot];
}

}  // namespace fathom::telemetry::packet
