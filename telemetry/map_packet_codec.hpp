#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstdlib>

#include "telemetry/map_block.hpp"
#include "telemetry/range_coder.hpp"

// The walk over a map packet that encoder and decoder share: each function below codes one part of the packet
// through a RangeEncoder (which takes the values from its arguments) or a RangeDecoder (which puts them
// there). Whole numbers only. README.md gives the same, byte by byte.
namespace fathom::telemetry::packet {

inline constexpr int kMaxSide = 64;                 // blocks along one edge of a packet's rectangle
inline constexpr int kMaxRectangle = 1024;          // blocks in the rectangle, present or not
inline constexpr int kMargin = 8;                   // nodes around the rectangle, never known
inline constexpr int kUnitsPerStep = 256;           // heights are computed in this fraction of the step
inline constexpr std::int32_t kMaxUnits = 1 << 28;  // of a height above or below the base
inline constexpr std::int32_t kMaxKey = 1 << 26;    // of a block, either way
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

struct Header {
  SpacingCode spacing = 0;
  int error_code = 0;
  int colour_bits = 0;
  int sigma_code = 0;
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
std::int32_t codeSigned(Coder& coder, std::int32_t value, unsigned usual_bits, unsigned max_bits) {
  const auto magnitude = static_cast<std::int32_t>(
      codeNumber(coder, static_cast<std::uint32_t>(std::abs(value)), usual_bits, max_bits));
  if (magnitude == 0) return 0;
  return coder.code(value < 0, kHalf) ? -magnitude : magnitude;
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
  h.sigma_code = static_cast<int>(codeRaw(coder, static_cast<std::uint32_t>(h.sigma_code), 3));
  h.north = codeSigned(coder, h.north, 7, 26);
  h.east = codeSigned(coder, h.east, 7, 26);
  h.base = codeSigned(coder, h.base, 8, 24);
  h.rows = 1 + static_cast<int>(codeNumber(coder, static_cast<std::uint32_t>(h.rows - 1), 3, 6));
  h.cols = 1 + static_cast<int>(codeNumber(coder, static_cast<std::uint32_t>(h.cols - 1), 3, 6));
  return h.rows <= kMaxSide && h.cols <= kMaxSide && h.rows * h.cols <= kMaxRectangle;
}

// A packet's content on a grid of nodes with a margin.
struct Patch {
  static constexpr std::size_t kGrid =
      (kMaxSide * 4 + 2 * kMargin) * (kMaxRectangle / kMaxSide * 4 + 2 * kMargin);
  enum State : std::uint8_t { kAbsent, kUnseen, kSeen, kKnown };

  int rows = 0, cols = 0, pitch = 0;
  std::array<bool, kMaxRectangle> included{};
  std::array<State, kGrid> state{};
  std::array<std::int32_t, kGrid> target{};  // encoder: the heights wanted [units]
  std::array<std::int32_t, kGrid> height{};  // as decoded [units]
  std::array<std::uint8_t, kGrid> size{};    // of the residual

  void shape(int rows_, int cols_) {
    rows = rows_;
    cols = cols_;
    pitch = cols * MapBlock::kSide + 2 * kMargin;
    const auto used = static_cast<std::size_t>((rows * MapBlock::kSide + 2 * kMargin) * pitch);
    std::fill_n(included.begin(), rows * cols, false);
    std::fill_n(state.begin(), used, kAbsent);
    std::fill_n(size.begin(), used, std::uint8_t{0});
  }
  [[nodiscard]] int at(int i, int j) const { return (i + kMargin) * pitch + j + kMargin; }
  [[nodiscard]] bool has(int r, int c) const {
    return r >= 0 && c >= 0 && r < rows && c < cols && included[static_cast<std::size_t>(r * cols + c)];
  }
};

// Which blocks of the rectangle are there; false if there are too many.
template <class Coder>
bool codeBlocks(Coder& coder, Patch& patch, std::size_t max_blocks) {
  std::array<AdaptiveBit, 8> chance;
  for (std::size_t k = 0; k < 8; ++k)
    chance[k] = AdaptiveBit(std::popcount(k) >= 2 ? 60000U : std::popcount(k) == 1 ? kHalf : 16000U, 3);
  std::size_t count = 0;
  for (int r = 0; r < patch.rows; ++r) {
    for (int c = 0; c < patch.cols; ++c) {
      const std::size_t context = (patch.has(r - 1, c) || r == 0 ? 1U : 0U) |
                                  (patch.has(r, c - 1) || c == 0 ? 2U : 0U) |
                                  (patch.has(r - 1, c + 1) || r == 0 ? 4U : 0U);
      bool& here = patch.included[static_cast<std::size_t>(r * patch.cols + c)];
      here = codeBit(coder, chance[context], here);
      if (here && ++count > max_blocks) return false;
    }
  }
  return count > 0;
}

// Which nodes were seen. `seen(r, c, node)` in the encoder: patch.state holds kSeen or kUnseen already.
template <class Coder>
void codeSeen(Coder& coder, Patch& patch) {
  using State = Patch::State;
  bool full = true;
  if constexpr (Coder::kEncodes)
    full = std::none_of(patch.state.begin(),
                        patch.state.begin() + (patch.rows * MapBlock::kSide + 2 * kMargin) * patch.pitch,
                        [](State s) { return s == State::kUnseen; });
  full = coder.code(full, kHalf);
  std::array<AdaptiveBit, 16> chance;
  for (std::size_t k = 0; k < 16; ++k)
    chance[k] = AdaptiveBit(static_cast<Chance>(8000 + 12000 * std::popcount(k)), 3);
  AdaptiveBit whole(50000, 3);
  std::array<bool, kMaxSide> whole_here{};  // of the row of blocks
  for (int i = 0; i < patch.rows * MapBlock::kSide; ++i) {
    for (int j = 0; j < patch.cols * MapBlock::kSide; ++j) {
      const int r = i / MapBlock::kSide, c = j / MapBlock::kSide;
      if (!patch.has(r, c)) continue;
      bool& block_full = whole_here[static_cast<std::size_t>(c)];
      if (full) block_full = true;
      if (!full && i % MapBlock::kSide == 0 && j % MapBlock::kSide == 0) {
        if constexpr (Coder::kEncodes) {
          block_full = true;
          for (int n = 0; n < MapBlock::kNodes; ++n)
            block_full =
                block_full &&
                patch.state[static_cast<std::size_t>(patch.at(i + n / 4, j + n % 4))] == State::kSeen;
        }
        block_full = codeBit(coder, whole, block_full);
      }
      const int at = patch.at(i, j);
      State& state = patch.state[static_cast<std::size_t>(at)];
      if (block_full) {
        state = State::kSeen;
        continue;
      }
      const auto seen = [&](int k) { return patch.state[static_cast<std::size_t>(k)] == State::kSeen; };
      const std::size_t context = (seen(at - 1) ? 1U : 0U) | (seen(at - patch.pitch) ? 2U : 0U) |
                                  (seen(at - patch.pitch - 1) ? 4U : 0U) |
                                  (seen(at - patch.pitch + 1) ? 8U : 0U);
      state = codeBit(coder, chance[context], state == State::kSeen) ? State::kSeen : State::kUnseen;
    }
  }
}

// The heights: block corners first, then every second node, then the rest, each predicted from those around.
template <class Coder>
class HeightWalk {
 public:
  HeightWalk(Coder& coder, Patch& patch) : coder_(coder), patch_(patch) {
    for (auto& level : zero_) level = {AdaptiveBit(20000, 3), AdaptiveBit(32768, 3), AdaptiveBit(45000, 3)};
  }
  void run() {
    pass(4, 0, 0, 0);
    pass(4, 2, 2, 1);
    pass(4, 0, 2, 2);
    pass(4, 2, 0, 2);
    for (const auto& [i, j] : {std::pair{1, 1}, {1, 3}, {3, 1}, {3, 3}}) pass(4, i, j, 3);
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        if ((i + j) % 2 == 1) pass(4, i, j, 4);
  }

 private:
  struct Near {
    std::int32_t height;
    std::uint32_t size;  // 0 to 2: how large residuals were here
  };
  // Mean of what is known around at the distances in turn.
  Near predict(int at) const {
    static constexpr std::array<std::array<int, 2>, 24> kRings{
        {{0, 1}, {1, 0}, {0, -1}, {-1, 0}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1},
         {0, 2}, {2, 0}, {0, -2}, {-2, 0}, {2, 2}, {2, -2}, {-2, 2}, {-2, -2},
         {0, 4}, {4, 0}, {0, -4}, {-4, 0}, {4, 4}, {4, -4}, {-4, 4}, {-4, -4}}};
    for (std::size_t ring = 0; ring < kRings.size(); ring += 4) {
      std::int64_t sum = 0;
      std::uint32_t size = 0;
      int count = 0;
      for (std::size_t k = ring; k < ring + 4; ++k) {
        const auto n = static_cast<std::size_t>(at + kRings[k][0] * patch_.pitch + kRings[k][1]);
        if (patch_.state[n] != Patch::kKnown) continue;
        sum += patch_.height[n];
        size += patch_.size[n];
        ++count;
      }
      if (count > 0) return {static_cast<std::int32_t>(sum / count), std::min(size, 2U)};
    }
    return {last_, 1};
  }
  void pass(int step, int i0, int j0, std::size_t level) {
    for (int i = i0; i < patch_.rows * 4; i += step)
      for (int j = j0; j < patch_.cols * 4; j += step)
        if (patch_.state[static_cast<std::size_t>(patch_.at(i, j))] == Patch::kSeen)
          node(patch_.at(i, j), level);
  }
  void node(int at, std::size_t level) {
    const auto n = static_cast<std::size_t>(at);
    const Near near = predict(at);
    std::int32_t q = 0;
    if constexpr (Coder::kEncodes) {
      const std::int32_t d = patch_.target[n] - near.height;
      q = (std::abs(d) + kUnitsPerStep / 2) / kUnitsPerStep;
      if (d < 0) q = -q;
    }
    q = residual(q, level, near.size);
    patch_.height[n] = std::clamp(near.height + q * kUnitsPerStep, -kMaxUnits, kMaxUnits);
    patch_.size[n] = static_cast<std::uint8_t>(std::min(std::abs(q), 2));
    patch_.state[n] = Patch::kKnown;
    last_ = patch_.height[n];
  }
  std::int32_t residual(std::int32_t q, std::size_t level, std::size_t size) {
    if (!codeBit(coder_, zero_[level][size], q != 0)) return 0;
    const bool negative = coder_.code(q < 0, kHalf);
    const std::int32_t magnitude = std::abs(q);
    std::int32_t m = 1;
    while (m < kUnary &&
           codeBit(coder_, more_[std::min<std::size_t>(static_cast<std::size_t>(m - 1), 3)], magnitude > m))
      ++m;
    if (m == kUnary)
      m += static_cast<std::int32_t>(
          codeNumber(coder_, static_cast<std::uint32_t>(magnitude - kUnary), 3, 20));
    return negative ? -m : m;
  }

  static constexpr std::int32_t kUnary = 12;
  Coder& coder_;
  Patch& patch_;
  std::int32_t last_ = 0;
  std::array<std::array<AdaptiveBit, 3>, 5> zero_;
  std::array<AdaptiveBit, 4> more_{AdaptiveBit(14000, 3), AdaptiveBit(18000, 3), AdaptiveBit(20000, 3),
                                   AdaptiveBit(24000, 3)};
};

}  // namespace fathom::telemetry::packet
