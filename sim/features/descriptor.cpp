#include "sim/features/descriptor.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>

#include "recon/geometry/hash64.hpp"

namespace fathom::sim {
namespace {

constexpr std::size_t kBins = std::tuple_size_v<RootSift>, kLatent = 12;
constexpr float kOwn = 0.35F;  // standard deviation of a bin's own part, by that of the common one
constexpr float kNorm = 512, kTop = 255;

// A nearly normal number of unit variance from 16 bits: how many bits are set, and where.
float deviate(std::uint32_t bits) {
  constexpr float kScale = 0.494872F;  // 1 / sqrt(16 / 4 + 1 / 12): of the count and of the fraction
  const float fraction = static_cast<float>((bits * 40503U >> 4) & 0xFFF) / 4096.0F - 0.5F;
  return (static_cast<float>(std::popcount(bits & 0xFFFFU)) - 8.0F + fraction) * kScale;
}

// A stream of such numbers, four of each hash.
class Deviates {
 public:
  explicit Deviates(std::uint64_t seed) : state_(seed) {}
  float next() {
    if (left_ == 0) {
      bits_ = state_ = hash64(state_);
      left_ = 4;
    }
    --left_;
    const auto low = static_cast<std::uint32_t>(bits_ & 0xFFFF);
    bits_ >>= 16;
    return deviate(low);
  }

 private:
  std::uint64_t state_, bits_ = 0;
  int left_ = 0;
};

using Mixing = std::array<std::array<float, kLatent>, kBins>;

const Mixing& mixing() {
  static const Mixing kMixing = [] {
    Mixing m;
    Deviates random(0x46656174);
    for (auto& row : m) {
      float squares = 0;
      for (float& v : row) {
        v = random.next();
        squares += v * v;
      }
      for (float& v : row) v /= std::sqrt(squares);
    }
    return m;
  }();
  return kMixing;
}

}  // namespace

RootSift descriptorOf(std::uint64_t appearance, std::uint64_t view_seed, std::uint64_t feature, float noise) {
  Deviates own(hash64(appearance, 1)), view(hash64(hash64(appearance, view_seed), feature));
  std::array<float, kLatent> z;
  for (float& v : z) v = own.next();
  const Mixing& m = mixing();
  std::array<float, kBins> g;
  const float spread = noise * std::sqrt(1 + kOwn * kOwn);
  float squares = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    float sum = kOwn * own.next() + spread * view.next();
    for (std::size_t k = 0; k < kLatent; ++k) sum += m[i][k] * z[k];
    g[i] = std::abs(sum);
    squares += sum * sum;
  }
  const float scale = squares > 0 ? kNorm / std::sqrt(squares) : 0.0F;
  RootSift descriptor;
  for (std::size_t i = 0; i < kBins; ++i)
    descriptor[i] = static_cast<std::uint8_t>(std::lround(std::min(scale * g[i], kTop)));
  return descriptor;
}

}  // namespace fathom::sim
