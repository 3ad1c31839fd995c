#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "realtime/base/files/descriptor.hpp"
#include "realtime/onboard/slots/slot_store.hpp"

namespace fathom::onboard {

// Undo journal of a slot file: the old content of overwritten slots, to restore them to a mark. An epoch is
// the time from one mark to the next. Before a slot is written for the first time in an epoch, its old
// content is appended here, without trailing zeros. To return to a mark, the oldest content of every slot
// since then is restored.
//
// The file: a head (where the records begin, boot identifier of the machine), then records with checksums:
// marks and slots. After kill -9 all of it is valid; a record that the end of the file truncates was being
// written, so that its slot was not yet. After the machine was off, records may be missing at the end, and
// slots may have reached the disk without their records: intact records are used, and needsCheck() is true. A
// disk that refuses a record ends all epochs until the next mark.
class SlotJournal {
 public:
  // A further mark replaces the oldest: 43 minutes at one per ten seconds.
  static constexpr std::size_t kMostMarks = 256;

  // `reopen`: continues the journal of an earlier program.
  SlotJournal(Descriptor file, bool reopen, std::size_t slots, std::size_t slot_bytes);

  void mark(std::uint64_t number) noexcept;
  // Whether the slot's content must be kept before it is written: fill content(), then call keep(). Allocates
  // nothing.
  [[nodiscard]] bool wants(std::size_t slot) const noexcept { return !marks_.empty() && kept_[slot] == 0; }
  [[nodiscard]] std::span<std::uint8_t> content() noexcept;
  void keep(std::size_t slot, std::size_t bytes) noexcept;
  // Ends all epochs, because content could not be kept.
  void clear() noexcept;

  // Calls `restore` with the content that every changed slot had at the newest mark of that number; the rest
  // of a slot was zeros. False for an unknown mark, or when the disk or `restore` fails.
  using Restore = std::function<bool(std::size_t slot, std::span<const std::uint8_t> content)>;
  [[nodiscard]] bool eachSince(std::uint64_t number, const Restore& restore);
  // The slots were restored to that mark: its epoch begins again.
  void beginAgain(std::uint64_t number) noexcept;
  void forget(std::uint64_t before) noexcept;
  [[nodiscard]] bool needsCheck() const noexcept { return needs_check_; }
  void checked() noexcept;

  [[nodiscard]] bool sync() const noexcept;
  [[nodiscard]] std::uint64_t bytes() const noexcept;  // of records

 private:
  struct Mark {
    std::uint64_t number = 0, offset = 0;
  };
  struct Record;
  enum class Found { kRecord, kEnd, kCutShort, kDamaged };

  void takeUp();
  [[nodiscard]] bool writeHead(std::uint64_t first) noexcept;
  [[nodiscard]] bool append(Record record, std::size_t bytes) noexcept;
  [[nodiscard]] Found readRecord(std::uint64_t offset, std::uint64_t end, Record& record);
  [[nodiscard]] std::vector<Mark>::iterator find(std::uint64_t number) noexcept;
  void newEpoch() noexcept;

  Descriptor file_;
  std::size_t slots_, slot_bytes_;
  std::uint64_t boot_, end_ = 0;
  bool needs_check_ = false;
  std::vector<Mark> marks_;           // the oldest first
  std::vector<std::uint8_t> kept_;    // by slot: in this epoch
  std::vector<std::uint8_t> record_;  // head and content of one
};

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
