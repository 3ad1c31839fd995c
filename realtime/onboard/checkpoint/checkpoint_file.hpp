#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fathom::onboard {

// Identity and time of a checkpoint.
struct CheckpointHead {
  std::uint64_t configuration = 0;  // hash of all that shapes the state: program, configuration, calibration
  std::uint64_t mission = 0;        // hash of vehicle, dive and plan
  std::uint64_t number = 0;         // counts a mission's checkpoints, from 1
  std::uint64_t inputs = 0;         // consumed before it: the log's tail begins with the next
  std::int64_t utc_ns = 0;          // arrival of the newest of them

  friend bool operator==(const CheckpointHead&, const CheckpointHead&) = default;
};

// FNV-1a hash of bytes; `before`: the hash of the bytes that precede these, to continue it.
[[nodiscard]] std::uint64_t checkpointHash(std::string_view bytes,
                                           std::uint64_t before = 0xcbf29ce484222325ULL) noexcept;

// The two checkpoint files of a mission, `checkpoint-0.bin` and `checkpoint-1.bin` in a folder: while one is
// written the other is whole. A file is
//   u64 magic "FTHMCKPT", u32 format, u32 head's CRC-32, the head's five numbers (u64, i64), u64 bytes of
//   state, u32 their CRC-32, u32 0; the state (sections of state_archive.hpp, with checksums of their own).
// Little endian. The head's CRC covers what follows it up to the state.
//
// A restart tries the usable() ones in order: read() and load; if none can be used the log remains. That
// removes nothing; later checkpoints are numbered beyond newestNumber() and the log's marks.
class CheckpointFiles {
 public:
  // Makes the folder. Throws InputError when it cannot.
  explicit CheckpointFiles(std::filesystem::path folder);

  // Writes the state to a temporary file, flushes it to the disk and renames it to one of the two names:
  // never the one that this object read or wrote last; at first one that is not usable(), or the older.
  // False, with the old file kept, when the disk refuses: see error().
  [[nodiscard]] bool write(const CheckpointHead& head, std::span<const std::uint8_t> state) noexcept;
  [[nodiscard]] const std::string& error() const { return error_; }

  // Checkpoints of this configuration and mission with intact heads and files of the stated length, the
  // newest first. `said` receives a line for each file that is passed over, with the reason; here and below.
  [[nodiscard]] std::vector<CheckpointHead> usable(std::uint64_t configuration, std::uint64_t mission,
                                                   std::vector<std::string>& said) const;
  struct Found {
    CheckpointHead head;
    std::vector<std::uint8_t> state;
  };
  // The checkpoint of that number if all of it is whole.
  [[nodiscard]] std::optional<Found> read(std::uint64_t number, std::vector<std::string>& said);
  // The same into the caller's memory; returns the state in it and allocates nothing for it. Passed over if
  // it does not fit.
  [[nodiscard]] std::optional<std::span<const std::uint8_t>> read(std::uint64_t number,
                                                                  std::span<std::uint8_t> room,
                                                                  std::vector<std::string>& said);
  // The first bytes of its state, at most `bytes`. The sections in them carry their own checksums; the rest
  // of the state is not verified.
  [[nodiscard]] std::optional<Found> readStart(std::uint64_t number, std::size_t bytes,
                                               std::vector<std::string>& said) const;
  // The first of usable() that read() finds whole.
  [[nodiscard]] std::optional<Found> readNewest(std::uint64_t configuration, std::uint64_t mission,
                                                std::vector<std::string>& said);
  // Largest number among files with intact heads, of any mission; 0: none.
  [[nodiscard]] std::uint64_t newestNumber() const;

  void remove(std::uint64_t number) noexcept;
  // Removes both: a new mission begins.
  void remove() noexcept;

  // The file that has the checkpoint of that number; an empty path if none has.
  [[nodiscard]] std::filesystem::path file(std::uint64_t number) const;
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

 private:
  static constexpr std::size_t kFiles = 2;
  using Room = std::function<std::span<std::uint8_t>(const CheckpointHead& head, std::uint64_t bytes)>;
  [[nodiscard]] bool readInto(std::uint64_t number, const Room& room, std::vector<std::string>& said);
  [[nodiscard]] std::size_t placeFor(const CheckpointHead& head) const;

  std::filesystem::path folder_;
  std::array<std::filesystem::path, kFiles> paths_;
  std::optional<std::size_t> kept_;  // the file that was read or written last
  std::string error_;
};

// Decodes a checkpoint from untrusted bytes; an empty string, or why it is invalid.
[[nodiscard]] std::string decodeCheckpoint(std::span<const std::uint8_t> bytes, CheckpointHead& head,
                                           std::span<const std::uint8_t>& state);

// Transfers saved state from one thread, which never waits, to the disk by another. One buffer: while it is
// being written, the next checkpoint that is due is left out and counted.
//
//   soft tier:    if (auto buffer = writer.begin(); !buffer.empty()) { StateWriter w(buffer); ... save ...
//                   w.full() ? writer.giveUp() : writer.submit(head, w.size()); }
//   best effort:  writer.work() repeatedly, some times a second
class CheckpointWriter {
 public:
  // `capacity`: of the state [B]; taken and touched at once. `named`: files that a checkpoint relies on; they
  // are brought to the disk before it.
  CheckpointWriter(CheckpointFiles& files, std::size_t capacity, std::vector<std::filesystem::path> named);

  // Soft tier. Empty while the last one is still being written.
  [[nodiscard]] std::span<std::uint8_t> begin() noexcept;
  // `decisions`: number made by then, for waiting until the log has them.
  void submit(const CheckpointHead& head, std::size_t bytes, std::uint64_t decisions = 0) noexcept;
  void giveUp() noexcept { too_large_.fetch_add(1, std::memory_order_relaxed); }  // it does not fit

  // Best effort.
  [[nodiscard]] bool waiting() const noexcept { return waiting_.load(std::memory_order_acquire); }
  // Of the one that waits.
  [[nodiscard]] const CheckpointHead& head() const noexcept { return head_; }
  [[nodiscard]] std::uint64_t decisions() const noexcept { return decisions_; }
  // Writes the checkpoint that waits, if one does; true when it did.
  bool work();

  struct Counters {
    std::uint64_t written = 0, failed = 0, late = 0, too_large = 0;
    std::uint64_t bytes = 0;  // of the last one
    std::int64_t utc_ns = 0;  // of the last one that is on the disk
  };
  [[nodiscard]] Counters counters() const noexcept;
  // Number of the last but one written: a restart needs none before it. 0: unknown.
  [[nodiscard]] std::uint64_t oldest() const noexcept { return oldest_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t capacity() const { return buffer_.size(); }

 private:
  CheckpointFiles& files_;
  std::vector<std::uint8_t> buffer_;
  std::vector<std::filesystem::path> named_;
  CheckpointHead head_;
  std::size_t bytes_ = 0;
  std::uint64_t decisions_ = 0;
  std::uint64_t newest_ = 0;          // number of the last one written; best effort
  std::atomic<bool> waiting_{false};  // the buffer is the best effort's
  std::atomic<std::uint64_t> written_{0}, failed_{0}, late_{0}, too_large_{0}, last_bytes_{0};
  std::atomic<std::uint64_t> oldest_{0};
  std::atomic<std::int64_t> utc_ns_{0};
};

}  // namespace fathom::onboard
