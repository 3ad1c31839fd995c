#pragma once

#include <cstdint>

namespace fathom::closure {

// Scalar products of `n` by `m` vectors of kDotLength values of up to 255, each vector's values side by side:
// out[i + n j] = x_i . y_j. Whole numbers below 2^24, so that every instruction set gives the same floats.
constexpr int kDotLength = 128;
using DotProducts = void (*)(const std::int16_t* x, int n, const std::int16_t* y, int m, float* out);

// For the processor that this runs on; and the one that runs on any.
[[nodiscard]] DotProducts fastestDotProducts();
[[nodiscard]] DotProducts baselineDotProducts();

}  // namespace fathom::closure
