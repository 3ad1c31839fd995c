#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "realtime/kernel/descriptor.hpp"

namespace fathom::onboard {

// What the slots of a slot file held before they were written over, so that they can be as they were at a
// mark. An epoch goes from one mark to the next. Before a slot is written for the first time in an epoch its
// old content is appended here, without the zeros at its end. Going back to a mark: of every slot the oldest
// content since then.
//
// The file: a head (where the records begin, of which boot of the machine it is), then records, each with a
// checksum: marks and slots. After kill -9 all of it counts; a record that the file's end cuts short was
// being written, so that its slot was not yet. After the machine was off nobody knows whether records are
// missing at the end, nor which slots reached the disk without theirs: what is whole counts, and
// needsCheck(). A disk that refuses a record ends all epochs until the next mark.
class SlotJournal {
 public:
  // For another mark the oldest goes: 43 minutes at one in ten seconds.
  static constexpr std::size_t kMostMarks = 256;

  // `reopen`: takes up what an earlier program left in the file.
  SlotJournal(Descriptor file, bool reopen, std::size_t slots, std::size_t slot_bytes);

  void mark(std::uint64_t number) noexcept;
  // The slot's content has to be kept before it is written: fill content(), then keep(). Allocates nothing.
  [[nodiscard]] bool wants(std::size_t slot) const noexcept { return !marks_.empty() && kept_[slot] == 0; }
  [[nodiscard]] std::span<std::uint8_t> content() noexcept;
  void keep(std::size_t slot, std::size_t bytes) noexcept;
  // Ends all epochs: something could not be kept.
  void clear() noexcept;

  // Gives what every slot held at the newest mark of that number, if that was something else. The rest of a
  // slot was zeros. False for a mark that there is not, or when the disk or `restore` fails.
  using Restore = std::function<bool(std::size_t slot, std::span<const std::uint8_t> content)>;
  [[nodiscard]] bool eachSince(std::uint64_t number, const Restore& restore);
  // The slots are as at that mark: its epoch begins again.
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
