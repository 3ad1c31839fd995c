#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstdlib>

#include "telemetry/map/map_kriging.hpp"
#include "telemetry/map/map_packet.hpp"
#include "telemetry/map/range_coder.hpp"

// The walk over a map packet that encoder and decoder share: each function below codes one part of the
// packet, through a RangeEncoder from its arguments or through a RangeDecoder into them. Whole numbers only.
// README.md gives the same, byte by byte.
namespace fathom::telemetry::packet {

inline constexpr int kMaxSide = 64;                 // blocks along one edge of a packet's rectangle
inline constexpr int kMaxRectangle = 1024;          // blocks in the rectangle, present or not
inline constexpr int kMargin = 8;                   // nodes around the rectangle, never known
inline constexpr int kUnitsPerStep = 256;           // heights are computed in this fraction of the step
inline constexpr std::int32_t kMaxUnits = 1 << 28;  // of a height above or below the base
inline constexpr std::int32_t kMaxKey = 1 << 26;    // of a block, positive or negative
inline constexpr std::int32_t kMaxBase = 1 << 24;   // of the base depth [steps]

inline constexpr std::array<int, 32> kErrorDigits{10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20,
                                                  22, 24, 25, 26, 28, 30, 32, 34, 36, 38, 40,
                                                  45, 50, 55, 60, 65, 70, 75, 80, 85, 90};
inline constexpr int kErrorCodes = 96;                              // three decades: 1 to 900 mm
inline constexpr int kUsualError = 32 + 23;                         // 50 mm
inline constexpr SpacingCode kFineSpacing = 5, kCoarseSpacing = 7;  // 25 cm and 1 m

[[nodiscard]] inline double errorOf(int code) {
  double millimetres = kErrorDigits[static_cast<std::size_t>(code % 32)] / 10.0;
  for (int decade = code / 32; decade > 0; --decade) millimetres *= 10;
  return millimetres * 1e-3;
}

// Mean size of residuals against the predictions' expected deviation, in 1 / 256: what a packet begins with.
inline constexpr std::array<std::int64_t, 4> kRoughness{128, 192, 288, 432};

inline constexpr int kUsualRoughness = 1;
inline constexpr int kSigmaCodes = 8;

struct Header {
  SpacingCode spacing = 0;
  int error_code = 0;
  int colour_bits = 0;
  int sigma_code = 0;
  int roughness = 0;
  std::int32_t north = 0, east = 0;  // of the rectangle's least block
  int rows = 0, cols = 0;            // of the rectangle [blocks]
  std::int32_t base = 0;             // depth that heights are relative to [steps]
};

// A number of any size: how many bits it has (each more half as likely), then those below the leading one.
template <class Coder>
std::uint32_t codeNumber(Coder& coder, std::uint32_t value, unsigned usual_bits, unsigned max_bits) {
  const unsigned width = static_cast<unsigned>(std::bit_width(value));
  unsigned bits = usual_bits;
  if (coder.code(width > usual_bits, kHalf / 2)) {
    for (++bits; bits < max_bits && coder.code(width > bits, kHalf); ++bits) {
    }
  } else {
    while (bits > 0 && coder.code(width < bits, kHalf * 3 / 4)) --bits;
  }
  if (bits <= 1) return bits;
  return 1U << (bits - 1) | codeRaw(coder, value & ((1U << (bits - 1)) - 1), bits - 1);
}
template <class Coder>
std::int32_t codeSigned(Coder& coder, std::int32_t value, unsigned usual_bits, unsigned max_bits,
                        Chance negative = kHalf) {
  const auto magnitude = static_cast<std::int32_t>(
      codeNumber(coder, static_cast<std::uint32_t>(std::abs(value)), usual_bits, max_bits));
  if (magnitude == 0) return 0;
  return coder.code(value < 0, negative) ? -magnitude : magnitude;
}

template <class Coder>
bool codeHeader(Coder& coder, Header& h) {
  if (coder.code(h.spacing == kFineSpacing, kHalf)) {
    h.spacing = kFineSpacing;
  } else if (coder.code(h.spacing == kCoarseSpacing, kHalf)) {
    h.spacing = kCoarseSpacing;
  } else if (coder.code(h.spacing < kPowerCodes, kHalf)) {
    h.spacing = static_cast<SpacingCode>(codeRaw(coder, h.spacing, 4));
    if (h.spacing >= kPowerCodes) return false;
  } else {
    h.spacing = static_cast<SpacingCode>(codeRaw(coder, h.spacing, 16));
    if (h.spacing <= kPowerCodes) return false;
  }
  if (coder.code(h.error_code == kUsualError, kHalf)) {
    h.error_code = kUsualError;
  } else {
    h.error_code = static_cast<int>(codeRaw(coder, static_cast<std::uint32_t>(h.error_code), 7));
    if (h.error_code >= kErrorCodes) return false;
  }
  if (coder.code(h.colour_bits > 0, kHalf)) {
    h.colour_bits = 1 + static_cast<int>(codeRaw(coder, static_cast<std::uint32_t>(h.colour_bits - 1), 3));
    if (h.colour_bits > 6) return false;
  } else {
    h.colour_bits = 0;
  }
  const int sigma_code = h.sigma_code;
  for (h.sigma_code = 0; h.sigma_code < kSigmaCodes - 1 && coder.code(sigma_code > h.sigma_code, kHalf);)
    ++h.sigma_code;
  h.roughness = static_cast<int>(codeRaw(coder, static_cast<std::uint32_t>(h.roughness), 2));
  h.north = codeSigned(coder, h.north, 7, 26);
  h.east = codeSigned(coder, h.east, 7, 26);
  h.base = codeSigned(coder, h.base, 8, 24, kMinChance);  // depths are seldom above the surface
  h.rows = 1 + static_cast<int>(codeNumber(coder, static_cast<std::uint32_t>(h.rows - 1), 2, 6));
  h.cols = 1 + static_cast<int>(codeNumber(coder, static_cast<std::uint32_t>(h.cols - 1), 2, 6));
  return h.rows <= kMaxSide && h.cols <= kMaxSide && h.rows * h.cols <= kMaxRectangle;
}

// Chance that a block is in the packet, by whether those to the west (1), north (2), north-west (4) and
// north-east (8) are: packets are patches without many holes.
inline constexpr std::array<Chance, 16> kBlockPrior{6000,  40000, 32000, 58000, 6000,  40000, 20000, 52000,
                                                    20000, 50000, 52000, 62500, 16000, 46000, 48000, 62500};
// Chance that a node was seen, by whether those to the west (1), north (2), north-west (4), north-east (8),
// second west (16) and second north (32) were: holes and edges are smooth.
[[nodiscard]] constexpr Chance seenPrior(std::size_t around) {
  constexpr std::array<int, 6> kWeight{5, 6, -2, 4, 1, 1};
  int sum = 0, all = 0;
  for (std::size_t k = 0; k < kWeight.size(); ++k) {
    all += kWeight[k];
    if ((around >> k & 1U) != 0) sum += kWeight[k];
  }
  constexpr std::array<Chance, 16> kChance{1300,  2600,  5000,  8000,  12000, 16000, 21000, 28000,
                                           36000, 43000, 49000, 53000, 57000, 60000, 62500, 64500};
  return kChance[static_cast<std::size_t>(std::clamp(sum, 0, all))];
}

// The order of the nodes: block corners first, then block middles, then every second node, then the rest.
struct Pass {
  Shape shape;  // of the neighbourhood that predicts them
  int stride;   // of it [nodes]
  int nodes;    // bit i * 4 + j: node (i, j) of every block
};
inline constexpr std::array<Pass, 5> kPasses{{{Shape::kSquare, 4, 0x0001},
                                              {Shape::kDiagonal, 2, 0x0400},
                                              {Shape::kSquare, 2, 0x0104},
                                              {Shape::kDiagonal, 1, 0xA0A0},
                                              {Shape::kSquare, 1, 0x5A5A}}};

// A packet's content on a grid of nodes with a margin.
struct Patch {
  static constexpr std::size_t kGrid =
      (kMaxSide * 4 + 2 * kMargin) * (kMaxRectangle / kMaxSide * 4 + 2 * kMargin);
  enum State : std::uint8_t { kAbsent, kUnseen, kSeen, kKnown };

  int rows = 0, cols = 0, pitch = 0;
  std::array<bool, kMaxRectangle> included{};
  std::array<State, kGrid> state{};
  std::array<std::int32_t, kGrid> value{};     // of the field that is being coded [units]
  std::array<std::int32_t, kGrid> activity{};  // of the residual against what was expected, in 1 / 256

  void shape(int rows_, int cols_) {
    rows = rows_;
    cols = cols_;
    pitch = cols * MapBlock::kSide + 2 * kMargin;
    std::fill_n(included.begin(), rows * cols, false);
    std::fill_n(state.begin(), used(), kAbsent);
  }
  // Makes all known nodes merely seen: another field begins.
  void forget() {
    for (std::size_t k = 0; k < used(); ++k)
      if (state[k] == kKnown) state[k] = kSeen;
  }
  [[nodiscard]] std::size_t used() const {
    return static_cast<std::size_t>((rows * MapBlock::kSide + 2 * kMargin) * pitch);
  }
  [[nodiscard]] int at(int i, int j) const { return (i + kMargin) * pitch + j + kMargin; }
  // Calls f(node) for the seen nodes of a pass, row by row.
  template <class F>
  void visit(const Pass& pass, const F& f) const {
    for (int i = 0; i < rows * MapBlock::kSide; ++i)
      for (int j = 0; j < cols * MapBlock::kSide; ++j)
        if ((pass.nodes >> (i % MapBlock::kSide * MapBlock::kSide + j % MapBlock::kSide) & 1) != 0 &&
            state[static_cast<std::size_t>(at(i, j))] == kSeen)
          f(at(i, j));
  }
  // The first node of the walk, -1 if nothing was seen.
  [[nodiscard]] int first() const {
    int found = -1;
    for (const Pass& pass : kPasses) {
      visit(pass, [&](int node) { found = found < 0 ? node : found; });
      if (found >= 0) break;
    }
    return found;
  }
  [[nodiscard]] bool has(int r, int c) const {
    return r >= 0 && c >= 0 && r < rows && c < cols && included[static_cast<std::size_t>(r * cols + c)];
  }
};

// Which blocks of the rectangle are there; false if there are too many.
template <class Coder>
bool codeBlocks(Coder& coder, Patch& patch, std::size_t max_blocks) {
  if (coder.code(std::all_of(patch.included.begin(), patch.included.begin() + patch.rows * patch.cols,
                             [](bool b) { return b; }),
                 kHalf)) {
    std::fill_n(patch.included.begin(), patch.rows * patch.cols, true);
    return static_cast<std::size_t>(patch.rows * patch.cols) <= max_blocks;
  }
  std::array<AdaptiveBit, 16> chance;
  for (std::size_t k = 0; k < chance.size(); ++k) chance[k] = AdaptiveBit(kBlockPrior[k], 10);
  std::size_t count = 0;
  for (int r = 0; r < patch.rows; ++r) {
    for (int c = 0; c < patch.cols; ++c) {
      const std::size_t context = (patch.has(r, c - 1) ? 1U : 0U) | (patch.has(r - 1, c) ? 2U : 0U) |
                                  (patch.has(r - 1, c - 1) ? 4U : 0U) | (patch.has(r - 1, c + 1) ? 8U : 0U);
      bool& here = patch.included[static_cast<std::size_t>(r * patch.cols + c)];
      here = codeBit(coder, chance[context], here);
      if (here && ++count > max_blocks) return false;
    }
  }
  return count > 0;
}

// Which nodes were seen: in the encoder, patch.state holds kSeen or kUnseen already.
template <class Coder>
void codeSeen(Coder& coder, Patch& patch) {
  using State = Patch::State;
  bool full = true;
  if constexpr (Coder::kEncodes)
    full = std::none_of(patch.state.begin(),
                        patch.state.begin() + (patch.rows * MapBlock::kSide + 2 * kMargin) * patch.pitch,
                        [](State s) { return s == State::kUnseen; });
  full = coder.code(full, kHalf);
  std::array<AdaptiveBit, 64> chance;
  for (std::size_t k = 0; k < chance.size(); ++k) chance[k] = AdaptiveBit(seenPrior(k), 4);
  for (int i = 0; i < patch.rows * MapBlock::kSide; ++i) {
    for (int j = 0; j < patch.cols * MapBlock::kSide; ++j) {
      if (!patch.has(i / MapBlock::kSide, j / MapBlock::kSide)) continue;
      const int at = patch.at(i, j);
      State& state = patch.state[static_cast<std::size_t>(at)];
      if (full) {
        state = State::kSeen;
        continue;
      }
      // What is not in the packet counts as its neighbour does, and all as seen where nothing is known.
      const auto seen = [&](int k, bool otherwise) {
        const State s = patch.state[static_cast<std::size_t>(k)];
        return s == State::kAbsent ? otherwise : s == State::kSeen;
      };
      const int up = at - patch.pitch;
      const bool west = seen(at - 1, seen(up, true)), north = seen(up, west);
      const std::size_t context = (west ? 1U : 0U) | (north ? 2U : 0U) | (seen(up - 1, north) ? 4U : 0U) |
                                  (seen(up + 1, north) ? 8U : 0U) | (seen(at - 2, west) ? 16U : 0U) |
                                  (seen(up - patch.pitch, north) ? 32U : 0U);
      state = codeBit(coder, chance[context], state == State::kSeen) ? State::kSeen : State::kUnseen;
    }
  }
}

}  // namespace fathom::telemetry::packet
