#pragma once

#include <cstddef>
#include <span>

#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {

// Which nodes of a lattice were seen, in the order of a walk over it. A full lattice costs one bit; otherwise
// the shorter of one bit a node and run lengths (Elias gamma, first run unseen, may be empty).
void putMask(BitWriter& writer, std::span<const bool> seen);
// Reads a mask of seen.size() nodes; false if the bits are not one.
[[nodiscard]] bool getMask(BitReader& reader, std::span<bool> seen);

}  // namespace fathom::telemetry
