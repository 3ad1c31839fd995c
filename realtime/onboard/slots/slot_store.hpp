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

  // For state that is saved beside the slots. A store without memory of what was there does nothing, and a
  // restart finds slots of a later time.
  // This is checkpoint `number`, from 1: rollBack() can come back to what the slots hold now.
  virtual void mark(std::uint64_t /*number*/) {}
  // Every slot holds what it held at that mark, from which the store then goes on; 0: zeros, as at first.
  // False when there was no such mark, it was forgotten, or what was there could not be kept.
  [[nodiscard]] virtual bool rollBack(std::uint64_t /*number*/) { return true; }
  // The machine was off since, or the disk damaged what slots held: a slot may hold what it held at no mark.
  // Who knows what each must hold looks, and calls checked() where all do; until then it stays so, also over
  // further starts.
  [[nodiscard]] virtual bool needsCheck() const { return false; }
  virtual void checked() {}
  // No mark before that one is needed any more.
  virtual void forget(std::uint64_t /*before*/) {}
};

}  // namespace fathom::onboard
