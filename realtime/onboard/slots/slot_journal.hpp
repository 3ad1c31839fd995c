#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "realtime/base/files/descriptor.hpp"

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

}  // namespace fathom::onboard
