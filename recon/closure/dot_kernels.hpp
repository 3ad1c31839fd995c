#pragma once

#include <cstdint>

#include "realtime/base/numbers/instruction_sets.hpp"

namespace fathom::closure {

// Scalar products of `n` by `m` vectors of kDotLength values of up to 255, each vector's values side by side:
// out[i + n j] = x_i . y_j. Whole numbers below 2^24, so that every instruction set gives the same floats.
constexpr int kDotLength = 128;
using DotProducts = void (*)(const std::int16_t* x, int n, const std::int16_t* y, int m, float* out);

FATHOM_INSTRUCTION_SETS(DotProducts, DotProducts);

}  // namespace fathom::closure
