#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "realtime/base/files/descriptor.hpp"
#include "realtime/onboard/slots/slot_journal.hpp"
#include "realtime/onboard/slots/slot_store.hpp"

namespace fathom::onboard {

// Slots in one file with blocks allocated on the disk at once, so that it cannot run full later.
//
// Slots carry no checksum: the writer keeps a hash of their content, which also detects a slot that is intact
// but holds other content (KeyframeFeatures, MovingMap).
//
// A journal beside the file (SlotJournal; `NAME.undo`, or without a name like the file) keeps the slots'
// content since the remembered marks: before a slot is overwritten for the first time since a mark, its
// content is appended to the journal. A disk that refuses the journal costs the marks, not the slots.
class SlotFile : public SlotStore {
 public:
  // A file without a name in an existing folder, which disappears with the program. Throws InputError when
  // the folder cannot be written or the disk lacks the room.
  SlotFile(const std::filesystem::path& folder, std::size_t slots, std::size_t slot_bytes);

  // A file with a name, which outlives the program. `reopen`: keeps the content if its size is right, see
  // kept(); otherwise it begins with zeros and without marks. Written slots survive a kill of the program; a
  // power loss only those written before sync().
  struct Named {
    std::filesystem::path file;
    bool reopen = false;
  };
  SlotFile(const Named& named, std::size_t slots, std::size_t slot_bytes);

  [[nodiscard]] std::size_t slots() const override { return slots_; }
  [[nodiscard]] std::size_t slotBytes() const override { return slot_bytes_; }
  [[nodiscard]] bool write(std::size_t slot, std::span<const std::uint8_t> data) override;
  [[nodiscard]] bool read(std::size_t slot, std::span<std::uint8_t> data) override;
  void mark(std::uint64_t number) override { journal_.mark(number); }
  // False also when the disk fails in the middle: then only a return to an older mark, or to 0, gives slots
  // of one time.
  [[nodiscard]] bool rollBack(std::uint64_t number) override;
  [[nodiscard]] bool needsCheck() const override { return journal_.needsCheck(); }
  void checked() override { journal_.checked(); }
  void forget(std::uint64_t before) override { journal_.forget(before); }

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }  // empty without a name
  [[nodiscard]] std::filesystem::path journalPath() const { return path_.string() + ".undo"; }
  [[nodiscard]] std::uint64_t journalBytes() const { return journal_.bytes(); }
  [[nodiscard]] bool kept() const { return kept_; }  // a named file's content of an earlier run
  // Flushes the slots and the journal to the disk; may be called while others write. False when the disk
  // fails.
  [[nodiscard]] bool sync() const;

 private:
  [[nodiscard]] bool fits(std::size_t slot, std::size_t bytes) const {
    return slot < slots_ && bytes <= slot_bytes_;
  }
  [[nodiscard]] Descriptor openNamed(const Named& named);
  // Takes the file's blocks from the disk; throws where there is no room.
  [[nodiscard]] Descriptor allocated(Descriptor file, const std::string& where) const;
  void keepOld(std::size_t slot);
  bool restore(std::size_t slot, std::span<const std::uint8_t> content);

  std::filesystem::path path_;
  std::size_t slots_, slot_bytes_;
  bool kept_ = false;
  Descriptor file_;
  std::vector<std::uint8_t> zeros_;       // a slot of them
  std::vector<std::uint8_t> known_zero_;  // by slot: nothing was ever written
  SlotJournal journal_;
};

}  // namespace fathom::onboard
