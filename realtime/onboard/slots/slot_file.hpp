#pragma once

#include <filesystem>
#include <string>

#include "realtime/onboard/slots/slot_store.hpp"

namespace fathom::onboard {

// Slots in one file whose blocks are taken from the disk at once, so that it cannot run full later.
//
// A slot carries no checksum: who writes one keeps the hash of its content, which also tells a slot that is
// whole but another's (KeyframeFeatures, MovingMap).
class SlotFile : public SlotStore {
 public:
  // A file without a name in an existing folder: it is gone with the program, however that ends. Throws
  // InputError when the folder cannot be written or the disk has no such room.
  SlotFile(const std::filesystem::path& folder, std::size_t slots, std::size_t slot_bytes);

  // A file with a name, which outlives the program. `reopen`: what is there is kept, if its size is right;
  // kept() says so. Else, and where there is none, it begins with zeros. What was written is there after the
  // program was killed; after a power loss only what was written before sync().
  struct Named {
    std::filesystem::path file;
    bool reopen = false;
  };
  SlotFile(const Named& named, std::size_t slots, std::size_t slot_bytes);
  ~SlotFile() override;
  SlotFile(const SlotFile&) = delete;
  SlotFile& operator=(const SlotFile&) = delete;

  [[nodiscard]] std::size_t slots() const override { return slots_; }
  [[nodiscard]] std::size_t slotBytes() const override { return slot_bytes_; }
  [[nodiscard]] bool write(std::size_t slot, std::span<const std::uint8_t> data) override;
  [[nodiscard]] bool read(std::size_t slot, std::span<std::uint8_t> data) override;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }  // empty without a name
  [[nodiscard]] bool kept() const { return kept_; }  // a named file's content of an earlier run
  // Brings all that was written to the disk; may be called while others write. False when the disk fails.
  [[nodiscard]] bool sync();

 private:
  [[nodiscard]] bool fits(std::size_t slot, std::size_t bytes) const {
    return slot < slots_ && bytes <= slot_bytes_;
  }
  // Takes the file's blocks from the disk; closes it and throws where there is no room.
  void allocate(const std::string& where);

  std::filesystem::path path_;
  std::size_t slots_, slot_bytes_;
  bool kept_ = false;
  int file_ = -1;
};

}  // namespace fathom::onboard
