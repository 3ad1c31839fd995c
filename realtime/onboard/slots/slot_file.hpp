#pragma once

#include <filesystem>

#include "realtime/onboard/slots/slot_store.hpp"

namespace fathom::onboard {

// Slots in one file whose blocks are taken from the disk at once, so that it cannot run full later. The file
// has no name: it is gone with the program, however that ends.
class SlotFile : public SlotStore {
 public:
  // In an existing folder. Throws InputError when the folder cannot be written or the disk has no such room.
  SlotFile(const std::filesystem::path& folder, std::size_t slots, std::size_t slot_bytes);
  ~SlotFile() override;
  SlotFile(const SlotFile&) = delete;
  SlotFile& operator=(const SlotFile&) = delete;

  [[nodiscard]] std::size_t slots() const override { return slots_; }
  [[nodiscard]] std::size_t slotBytes() const override { return slot_bytes_; }
  [[nodiscard]] bool write(std::size_t slot, std::span<const std::uint8_t> data) override;
  [[nodiscard]] bool read(std::size_t slot, std::span<std::uint8_t> data) override;

 private:
  [[nodiscard]] bool fits(std::size_t slot, std::size_t bytes) const {
    return slot < slots_ && bytes <= slot_bytes_;
  }
  std::size_t slots_, slot_bytes_;
  int file_ = -1;
};

}  // namespace fathom::onboard
