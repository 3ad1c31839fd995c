#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/bytes/state_archive.hpp"

namespace fathom::test {

// All that a class saves.
template <typename T>
std::vector<std::uint8_t> savedState(const T& object) {
  for (std::size_t size = std::size_t{1} << 16;; size *= 4) {
    std::vector<std::uint8_t> bytes(size);
    rt::StateWriter writer(bytes);
    object.save(writer);
    if (writer.full()) continue;
    bytes.resize(writer.size());
    return bytes;
  }
}

// Damages saved state that is made of sections in some `places`, one at a time, with right checksums, and
// calls `load` with it.
inline void eachDamage(const std::vector<std::uint8_t>& state, std::size_t places,
                       const std::function<void(std::span<const std::uint8_t>)>& load) {
  std::vector<std::uint8_t> bytes = state;
  for (std::size_t at = 0; at < state.size();) {
    rt::StateSectionHead head;
    std::memcpy(&head, state.data() + at, sizeof head);
    const std::size_t first = at + sizeof head;
    const auto seal = [&] {
      head.crc = crc32(std::span<const std::uint8_t>(bytes).subspan(first, head.bytes));
      std::memcpy(bytes.data() + at, &head, sizeof head);
    };
    const std::size_t step = std::max<std::size_t>(1, state.size() / places);
    for (std::size_t k = first; k < first + head.bytes; k += step) {
      for (const std::uint8_t flip : {0x01, 0x80, 0xFF}) {
        bytes[k] ^= flip;
        seal();
        load(bytes);
        bytes[k] = state[k];
      }
    }
    seal();
    at = first + head.bytes;
  }
}

// Cut off in some `places`, and with a bit wrong there: never loaded.
inline void eachRefused(const std::vector<std::uint8_t>& state, std::size_t places,
                        const std::function<bool(std::span<const std::uint8_t>)>& load) {
  for (std::size_t k = 0; k < places; ++k) {
    const std::size_t at = state.size() * k / places;
    EXPECT_FALSE(load(std::span<const std::uint8_t>(state).first(at))) << "cut off at " << at;
    if (at < sizeof(rt::StateSectionHead)) continue;
    std::vector<std::uint8_t> bytes = state;
    bytes[at] ^= 0x10;
    EXPECT_FALSE(load(bytes)) << "a bit at " << at;
  }
}

}  // namespace fathom::test
