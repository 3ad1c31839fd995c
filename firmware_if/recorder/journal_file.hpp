#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "realtime/base/files/descriptor.hpp"

namespace fathom::io {

// sensors.lcmlog as an append-only journal. Events gather in memory of a fixed size, go to the system in
// pieces, and stay in memory until sync() has put them on the disk. Room is taken on the disk behind the end
// of the file (FALLOC_FL_KEEP_SIZE: the file's size stays that of its events, so that every reader of LCM
// logs reads it); close() gives unused room back.
//
// The next write() tries again what the disk refused; until then the file may end in a part of an event,
// which readers pass over. After a failed sync everything since the last good one is written again: the
// system may have dropped it. A file that cannot be read is never cut.
class JournalFile {
 public:
  // Takes the memory; no file yet.
  JournalFile();

  // Continues an existing log behind its last whole event; anything behind that is cut away. `room` is taken
  // beforehand as far as the disk has it, leaving `leave_free` [bytes]. False when the disk refuses, or the
  // end of the log cannot be read: then no event is cut, and it may be called again. Throws InputError for a
  // file that is no LCM log.
  [[nodiscard]] bool open(const std::filesystem::path& path, std::uint64_t room, std::uint64_t leave_free);
  [[nodiscard]] bool isOpen() const noexcept { return file_.open(); }

  // The rest only while it is open. The event takes at most spare() bytes with its framing.
  void append(std::int64_t timestamp_us, std::string_view channel, std::span<const std::uint8_t> data);
  // Hands what gathered to the system; false when it refuses.
  [[nodiscard]] bool write() noexcept;
  // Waits until the disk holds all that was written; false when it reports a failure.
  [[nodiscard]] bool sync() noexcept;
  // Gives back the room behind the end. Nothing is appended after.
  void close() noexcept;

  // Reason of the last open(), write() or sync() that was refused, in words.
  [[nodiscard]] const std::string& failure() const noexcept { return failure_; }
  // What the memory has left [bytes]: little when the disk has refused for long, or when sync() is due.
  [[nodiscard]] std::size_t spare() const noexcept;
  // The disk holds everything that was appended.
  [[nodiscard]] bool safe() const noexcept { return memory_.empty(); }
  // Some of it was written and waits for sync().
  [[nodiscard]] bool unsynced() const noexcept { return written_ > 0; }
  [[nodiscard]] std::uint64_t size() const noexcept { return synced_ + written_; }
  [[nodiscard]] std::uint64_t wholeAtStart() const noexcept { return whole_at_start_; }
  [[nodiscard]] std::uint64_t cutAtStart() const noexcept { return cut_at_start_; }

 private:
  [[nodiscard]] bool continueBehind(int fd, const std::filesystem::path& path);
  [[nodiscard]] bool refused(const char* what) noexcept;
  void dropFromCache() noexcept;
  void takeRoom(std::uint64_t room, std::uint64_t leave_free) noexcept;

  Descriptor file_;
  std::int64_t next_number_ = 0;
  std::uint64_t synced_ = 0;       // of the file on the disk for certain
  std::uint64_t cached_from_ = 0;  // the system's cache was emptied up to here
  std::uint64_t whole_at_start_ = 0, cut_at_start_ = 0;
  std::vector<std::uint8_t> memory_;  // what follows synced_
  std::size_t written_ = 0;           // of memory_, handed to the system
  std::string failure_;
};

}  // namespace fathom::io
