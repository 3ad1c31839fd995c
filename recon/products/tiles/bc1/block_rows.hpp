#pragma once

#include <cstdint>

#include "realtime/base/numbers/instruction_sets.hpp"

namespace fathom::topside {

// Compresses one row of blocks, four image rows given by their first samples (RGB, 8 bits), `blocks` blocks
// of four pixels; 8 bytes a block go to `out`. The rows hold 12 * blocks samples.
using CompressBlockRow = void (*)(const std::uint8_t* const rows[4], int blocks, std::uint8_t* out);

FATHOM_INSTRUCTION_SETS(CompressBlockRow, BlockRow);

}  // namespace fathom::topside
