#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace fathom::onboard {

// A fixed number of blocks of one size, kept outside memory: bulky data that is rarely read.
class SlotStore {
 public:
  virtual ~SlotStore() = default;
  [[nodiscard]] virtual std::size_t slots() const = 0;
  [[nodiscard]] virtual std::size_t slotBytes() const = 0;
  // The first data.size() bytes of a slot; false when the disk fails, the slot does not exist, or it is
  // smaller.
  [[nodiscard]] virtual bool write(std::size_t slot, std::span<const std::uint8_t> data) = 0;
  [[nodiscard]] virtual bool read(std::size_t slot, std::span<std::uint8_t> data) = 0;
};

}  // namespace fathom::onboard
