#pragma once

#include <cstdint>

namespace fathom {

// Finaliser of SplitMix64 (Steele, Lea and Flood 2014), a bijective hash. Random numbers derived from it
// depend on what they belong to (seed, object, pixel), never on the order in which threads draw them.
[[nodiscard]] constexpr std::uint64_t hash64(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}
[[nodiscard]] constexpr std::uint64_t hash64(std::uint64_t a, std::uint64_t b) {
  return hash64(hash64(a) ^ b);
}

}  // namespace fathom
