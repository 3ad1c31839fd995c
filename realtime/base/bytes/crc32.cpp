#include "realtime/base/bytes/crc32.hpp"

#include <isa-l/crc.h>

namespace fathom {

std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t before) noexcept {
  return crc32_gzip_refl(before, bytes.data(), bytes.size());
}

}  // namespace fathom
