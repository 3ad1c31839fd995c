#pragma once

#include "realtime/kernel/state_archive.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

// What `write` gives to a StateWriter, in a block as long as it needs.
template <typename Write>
[[nodiscard]] Bytes savedBytes(const Write& write) {
  rt::StateWriter measure{std::span<std::uint8_t>()};
  write(measure);
  Bytes bytes(measure.needed());
  rt::StateWriter writer(bytes);
  write(writer);
  return bytes;
}

}  // namespace fathom::topside
