#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "telemetry/map/map_packet_walk.hpp"

namespace fathom::telemetry::packet {

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
