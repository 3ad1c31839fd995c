#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fathom::telemetry::packet {

// Prediction of a node's height from decoded nodes around it: ordinary kriging (Matheron, 1963; Cressie,
// Statistics for Spatial Data, 3.2) of a surface whose height differences grow with distance h as gamma(h) =
// E^2 h^1.5 (h in nodes, E the error bound: seafloor is close to fractal with Hurst exponent 0.75), seen with
// noise of variance 0.3 E^2: what rounding within +-E leaves. The noise term keeps the prediction from
// amplifying rounding; one-sided neighbourhoods at the map's edge extrapolate by the same equations. Whole
// numbers only.
struct Offset {
  int north, east;  // nodes
};

inline constexpr std::size_t kCandidates = 24;  // nodes around that may be used
inline constexpr std::size_t kNeighbours = 16;  // of them used: the nearest known ones
inline constexpr int kWeightBits = 14;          // weights are in 1 / 2^14 and sum to one

struct KrigingWeights {
  std::uint32_t used = 0;  // bit k: candidate k is used
  int count = 0;
  std::array<std::uint8_t, kNeighbours> candidate{};
  std::array<std::int32_t, kNeighbours> weight{};
  std::int32_t deviation = 0;  // expected of the prediction, in E / 256
};

// The two shapes of neighbourhood: nodes on every place of a square lattice, or on its black squares (those
// diagonal to the middle). Nearest first, then north to south, then west to east.
enum class Shape : std::uint8_t { kSquare, kDiagonal };
[[nodiscard]] const std::array<Offset, kCandidates>& candidates(Shape shape);

// Weights of a pattern of known candidates (bit k: candidate k is used; at least one, at most kNeighbours),
// on a lattice stretched by `stride` nodes. A pure function, cached in a table of fixed size.
class KrigingTable {
 public:
  KrigingTable();
  const KrigingWeights& weights(Shape shape, int stride, std::uint32_t used);

 private:
  static constexpr std::size_t kSlots = 2048;  // cached patterns; a new one replaces that of its slot
  std::vector<KrigingWeights> slots_;
  std::vector<std::uint32_t> keys_;
};

// gamma of a squared distance of 0 to 512 [E^2 / 65536].
[[nodiscard]] std::int64_t variogram(std::int64_t squared_distance);
[[nodiscard]] KrigingWeights solveKriging(Shape shape, int stride, std::uint32_t used);

}  // namespace fathom::telemetry::packet
