#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

#include "telemetry/map/map_packet_codec.hpp"

namespace fathom::telemetry::packet {

// log2 of x > 0 in sixteenths, straight between powers of two.
[[nodiscard]] inline int logSixteenths(std::int64_t x) {
  const int top = std::bit_width(static_cast<std::uint64_t>(x)) - 1;
  const std::int64_t mantissa = top >= 4 ? x >> (top - 4) : x << (4 - top);
  return 16 * top + static_cast<int>(mantissa) - 16;
}

// A chance that depends on a scale: learned at points half an octave apart, taken between the two nearest.
class ScaledBit {
 public:
  static constexpr std::size_t kPoints = 17;
  static constexpr int kLeastLog = -3 * 16;  // of the scale, in sixteenths: the first point
  explicit ScaledBit(const std::array<Chance, kPoints>& prior) {
    for (std::size_t k = 0; k < kPoints; ++k) point_[k] = AdaptiveBit(prior[k], kPriorWeight);
  }
  template <class Coder>
  bool code(Coder& coder, int log, bool value) {
    const int place = std::clamp(log - kLeastLog, 0, static_cast<int>(kPoints - 1) * 8 - 1);
    AdaptiveBit& below = point_[static_cast<std::size_t>(place / 8)];
    AdaptiveBit& above = point_[static_cast<std::size_t>(place / 8 + 1)];
    const auto part = static_cast<Chance>(place % 8);
    value = coder.code(
        value, std::clamp((below.chance() * (8 - part) + above.chance() * part) / 8, kMinChance, kMaxChance));
    below.learn(value);
    above.learn(value);
    return value;
  }

 private:
  static constexpr unsigned kPriorWeight = 16;  // decisions that the prior counts for
  std::array<AdaptiveBit, kPoints> point_;
};

// Of residuals with Laplace's distribution, at scales from E / 8 to 32 E: that the value is more than E away
// from the prediction, and that it is more than one step further than that, 2 E.
inline constexpr std::array<Chance, ScaledBit::kPoints> kSomePrior{262,   262,   592,   2351,  6231,  12413,
                                                                   20209, 28522, 36392, 43235, 48836, 53230,
                                                                   56573, 59063, 60890, 62215, 63170};
inline constexpr std::array<Chance, ScaledBit::kPoints> kMorePrior{1966,  1966,  1966,  1966,  1966,  2351,
                                                                   6231,  12413, 20209, 28522, 36392, 43235,
                                                                   48836, 53230, 56573, 59063, 60890};

// A field over the seen nodes, pass after pass, each value predicted from those of the known nodes around it.
// The residual is coded in whole steps at the scale that the prediction's expected deviation and the
// residuals around it give. Nodes of passes from `coded` on take what is predicted.
template <class Coder>
class FieldWalk {
 public:
  // `wanted`: of every node of the patch's grid, less the base [units]; the encoder's alone.
  FieldWalk(Coder& coder, Patch& patch, KrigingTable& table, int roughness, const std::int32_t* wanted,
            std::size_t coded = kPasses.size())
      : coder_(coder),
        patch_(patch),
        table_(table),
        wanted_(wanted),
        coded_(coded),
        mean_sum_(kMeanWeight * kRoughness[static_cast<std::size_t>(roughness)]) {}
  void run() {
    patch_.forget();
    for (std::size_t k = 0; k < kPasses.size(); ++k) {
      begin(kPasses[k]);
      patch_.visit(kPasses[k], [&](int at) { node(at, kPasses[k], k < coded_); });
    }
  }
  // How large residuals were against what the predictions expected, in 1 / 256.
  [[nodiscard]] std::int64_t meanActivity() const { return mean_sum_ / mean_count_; }

 private:
  void begin(const Pass& pass) {
    const auto& offsets = candidates(pass.shape);
    for (std::size_t k = 0; k < kCandidates; ++k) {
      const Offset o{pass.stride * offsets[k].north, pass.stride * offsets[k].east};
      around_[k] = o.north * patch_.pitch + o.east;
      nearness_[k] = kNearWeight / (o.north * o.north + o.east * o.east);
    }
  }
  void node(int at, const Pass& pass, bool coded) {
    const auto n = static_cast<std::size_t>(at);
    std::uint32_t used = 0;
    int count = 0;
    for (std::size_t k = 0; k < kCandidates && count < static_cast<int>(kNeighbours); ++k) {
      if (patch_.state[static_cast<std::size_t>(at + around_[k])] != Patch::kKnown) continue;
      used |= 1U << k;
      ++count;
    }
    std::int32_t predicted = last_;
    std::int64_t deviation = kLostDeviation;
    std::int64_t activity = kOwnWeight * (mean_sum_ / mean_count_), weight = kOwnWeight;
    if (used != 0) {
      const KrigingWeights& w = table_.weights(pass.shape, pass.stride, used);
      const std::int32_t first = patch_.value[static_cast<std::size_t>(at + around_[w.candidate[0]])];
      std::int64_t sum = 0;
      for (std::size_t k = 0; k < static_cast<std::size_t>(w.count); ++k) {
        const auto from = static_cast<std::size_t>(at + around_[w.candidate[k]]);
        sum += std::int64_t{w.weight[k]} * (patch_.value[from] - first);
        activity += nearness_[w.candidate[k]] * patch_.activity[from];
        weight += nearness_[w.candidate[k]];
      }
      predicted = static_cast<std::int32_t>(
          std::clamp<std::int64_t>(first + (sum >> kWeightBits), -kMaxUnits, kMaxUnits));
      deviation = w.deviation;
    }
    patch_.state[n] = Patch::kKnown;
    if (!coded) {
      patch_.value[n] = predicted;
      patch_.activity[n] = static_cast<std::int32_t>(mean_sum_ / mean_count_);
      return;
    }
    std::int32_t q = 0;
    if constexpr (Coder::kEncodes) {
      const std::int32_t d = wanted_[n] - predicted;
      q = (std::abs(d) + kUnitsPerStep / 2) / kUnitsPerStep;
      if (d < 0) q = -q;
    }
    const std::int64_t scale = std::max<std::int64_t>(deviation * (activity / weight) >> 8, 1);
    // The first node stands at the base.
    q = mean_count_ == kMeanWeight ? 0 : residual(q, logSixteenths(scale) - 8 * 16);
    patch_.value[n] = static_cast<std::int32_t>(
        std::clamp<std::int64_t>(predicted + std::int64_t{q} * kUnitsPerStep, -kMaxUnits, kMaxUnits));
    last_ = patch_.value[n];
    // In E / 256, then against what was expected.
    const std::int64_t size = q == 0 ? kZeroSize : std::min<std::int64_t>(std::abs(q), 64) * 512;
    patch_.activity[n] = static_cast<std::int32_t>(size * 256 / deviation);
    if (mean_count_ == kMeanWeight) patch_.activity[n] = static_cast<std::int32_t>(mean_sum_ / mean_count_);
    mean_sum_ += patch_.activity[n];
    ++mean_count_;
  }
  std::int32_t residual(std::int32_t q, int log) {
    if (!some_.code(coder_, log, q != 0)) return 0;
    const bool negative = coder_.code(q < 0, kHalf);
    const std::int32_t magnitude = std::abs(q);
    std::int32_t m = 1;
    if (more_.code(coder_, log, magnitude > 1)) {
      ++m;
      while (m < kUnary && further_.code(coder_, log, magnitude > m)) ++m;
      if (m == kUnary)
        m += static_cast<std::int32_t>(
            codeNumber(coder_, static_cast<std::uint32_t>(magnitude - kUnary), 3, 21));
    }
    return negative ? -m : m;
  }

  static constexpr std::int32_t kUnary = 20;
  static constexpr std::int64_t kZeroSize = 115;   // 0.45 E: what a residual of no step is on average
  static constexpr std::int64_t kOwnWeight = 192;  // of the mean over the packet, in local activity
  static constexpr int kNearWeight = 512;          // of a neighbour's activity, over squared distance
  static constexpr std::int64_t kMeanWeight = 8;   // nodes that the packet's roughness counts for
  static constexpr std::int64_t kLostDeviation = 16 * 256;  // where nothing around is known
  Coder& coder_;
  Patch& patch_;
  KrigingTable& table_;
  const std::int32_t* wanted_;
  std::size_t coded_;
  std::int64_t mean_sum_, mean_count_ = kMeanWeight;
  std::int32_t last_ = 0;
  std::array<int, kCandidates> around_{};
  std::array<int, kCandidates> nearness_{};
  ScaledBit some_{kSomePrior}, more_{kMorePrior}, further_{kMorePrior};
};

// Colour as brightness and two colour differences (YCoCg; Malvar and Sullivan, 2003), each a field like the
// heights. The differences are coded at every second node and interpolated between. Their step is half of the
// brightness's: water leaves little of them.
inline constexpr int kMaxColourBits = 6;
inline constexpr std::size_t kPlanes = 3;            // Y, Co, Cg
inline constexpr std::size_t kDifferencePasses = 3;  // of kPasses that code differences

struct Colours {
  using Plane = std::array<std::int32_t, Patch::kGrid>;
  std::array<Plane, kPlanes> wanted{}, decoded{};  // [units of the plane's step / kUnitsPerStep]
};

[[nodiscard]] constexpr int planeStep(std::size_t plane, int bits) {  // of 0 to 255
  const int luma = 256 >> bits;
  return plane == 0 ? luma : luma / 2;
}

inline void wantColour(Colours& colours, std::size_t node, const Rgb& rgb, int bits) {
  const int r = rgb[0], g = rgb[1], b = rgb[2];
  // 4 Y, 4 Co and 4 Cg, in whole numbers.
  const std::array<int, kPlanes> four{r + 2 * g + b, 2 * (r - b), 2 * g - r - b};
  for (std::size_t k = 0; k < kPlanes; ++k)
    colours.wanted[k][node] = four[k] * (kUnitsPerStep / 4) / planeStep(k, bits);
}

[[nodiscard]] inline Rgb shownColour(const Colours& colours, std::size_t node, int bits) {
  std::array<std::int64_t, kPlanes> v{};
  for (std::size_t k = 0; k < kPlanes; ++k)
    v[k] = (std::int64_t{colours.decoded[k][node]} * planeStep(k, bits) + kUnitsPerStep / 2) >> 8;
  const auto channel = [](std::int64_t x) {
    return static_cast<std::uint8_t>(std::clamp<std::int64_t>(x, 0, 255));
  };
  return {channel(v[0] - v[2] + v[1]), channel(v[0] + v[2]), channel(v[0] - v[2] - v[1])};
}

// The first node's value in whole steps, then the field against it.
template <class Coder>
void codeColours(Coder& coder, Patch& patch, KrigingTable& table, Colours& colours) {
  constexpr unsigned kUsualBits = 2;
  constexpr unsigned kMostBits = 8;  // 127 steps of 2
  patch.forget();
  const int first = patch.first();
  for (std::size_t k = 0; k < kPlanes; ++k) {
    Colours::Plane& wanted = colours.wanted[k];
    std::int32_t base = 0;
    if constexpr (Coder::kEncodes) {
      const std::int32_t v = wanted[static_cast<std::size_t>(first)];
      base = (v + (v < 0 ? -kUnitsPerStep : kUnitsPerStep) / 2) / kUnitsPerStep;
      for (std::size_t n = 0; n < patch.used(); ++n) colours.decoded[k][n] = wanted[n] - base * kUnitsPerStep;
    }
    base = codeSigned(coder, base, kUsualBits, kMostBits, k == 0 ? kMinChance : kHalf);
    FieldWalk<Coder>(coder, patch, table, kUsualRoughness, colours.decoded[k].data(),
                     k == 0 ? kPasses.size() : kDifferencePasses)
        .run();
    for (std::size_t n = 0; n < patch.used(); ++n)
      colours.decoded[k][n] = patch.value[n] + base * kUnitsPerStep;
  }
}

}  // namespace fathom::telemetry::packet
