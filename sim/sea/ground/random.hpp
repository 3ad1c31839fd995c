#pragma once

#include <cstdint>

#include "recon/geometry/hash64.hpp"

namespace fathom::sim {

// A short stream of random numbers that belongs to one thing.
class ThingRandom {
 public:
  ThingRandom(std::uint64_t seed, std::uint64_t thing) : state_(hash64(seed, thing)) {}
  std::uint64_t bits() { return state_ = hash64(state_); }
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1p-53; }  // [0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }

 private:
  std::uint64_t state_;
};

}  // namespace fathom::sim
