#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace fathom::onboard {

// A fixed number of equal blocks outside memory, for bulky data that is rarely read.
class SlotStore {
 public:
  virtual ~SlotStore() = default;
  [[nodiscard]] virtual std::size_t slots() const = 0;
  [[nodiscard]] virtual std::size_t slotBytes() const = 0;
  // The first data.size() bytes of a slot; false when the disk fails, the slot does not exist, or it is
  // smaller.
  [[nodiscard]] virtual bool write(std::size_t slot, std::span<const std::uint8_t> data) = 0;
  [[nodiscard]] virtual bool read(std::size_t slot, std::span<std::uint8_t> data) = 0;

  // Marks let saved state and slots return to one time. A store that keeps no history does nothing, and a
  // restart finds slots of a later time. mark(): this is checkpoint `number`, from 1; rollBack() can return
  // to what the slots hold now.
  virtual void mark(std::uint64_t /*number*/) {}
  // Restores every slot to that mark, from which the store continues; 0: zeros, as at first. False when there
  // was no such mark, it was forgotten, or the old content could not be kept.
  [[nodiscard]] virtual bool rollBack(std::uint64_t /*number*/) { return true; }
  // The machine was off since, or the disk damaged slots: a slot may hold content of no mark. The owner of
  // the content verifies every slot and calls checked() if all are right; until then this stays true, also
  // over further starts.
  [[nodiscard]] virtual bool needsCheck() const { return false; }
  virtual void checked() {}
  // Marks before `before` are no longer needed.
  virtual void forget(std::uint64_t /*before*/) {}
};

}  // namespace fathom::onboard
