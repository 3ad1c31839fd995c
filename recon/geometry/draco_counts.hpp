#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace fathom {

struct DracoCounts {
  std::uint32_t vertices = 0, faces = 0;
};

// What the head of a stream of Draco's bitstream 2.2 says that it holds, a triangular mesh by edgebreaker
// without flags; std::nullopt for any other bytes. Draco takes memory for these counts before it looks at the
// rest, so whoever decodes bytes from outside bounds them first.
[[nodiscard]] std::optional<DracoCounts> dracoCounts(std::span<const std::uint8_t> bytes);

}  // namespace fathom
