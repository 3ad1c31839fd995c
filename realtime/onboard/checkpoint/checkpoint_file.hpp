#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fathom::onboard {

// What a checkpoint is of, and from when.
struct CheckpointHead {
  std::uint64_t configuration = 0;  // hash of all that shapes the state: program, configuration, calibration
  std::uint64_t mission = 0;        // hash of vehicle, dive and plan
  std::uint64_t number = 0;         // counts a mission's checkpoints, from 1
  std::uint64_t inputs = 0;         // consumed before it: the log's tail begins with the next
  std::int64_t utc_ns = 0;          // arrival of the newest of them

  friend bool operator==(const CheckpointHead&, const CheckpointHead&) = default;
};

// FNV-1a of some text or bytes, for the two hashes; of several in a row, with that of those before.
[[nodiscard]] std::uint64_t checkpointHash(std::string_view bytes,
                                           std::uint64_t before = 0xcbf29ce484222325ULL) noexcept;

// The two checkpoint files of a mission, `checkpoint-0.bin` and `checkpoint-1.bin` in a folder of their own,
// written in turn: while one is written the other is whole. A file is
//   u64 magic "FTHMCKPT", u32 format, u32 head's CRC-32, the head's five numbers (u64, i64), u64 bytes of
//   state, u32 their CRC-32, u32 0; the state (sections of state_archive.hpp, with checksums of their own).
// Little endian. The head's CRC is over what follows it up to the state.
class CheckpointFiles {
 public:
  // Makes the folder. Throws InputError when it cannot.
  explicit CheckpointFiles(std::filesystem::path folder);

  // Writes the state to a temporary file, brings it to the disk and gives it the name of the older of the
  // two. False, and what was there stays, when the disk refuses: see error().
  [[nodiscard]] bool write(const CheckpointHead& head, std::span<const std::uint8_t> state) noexcept;
  [[nodiscard]] const std::string& error() const { return error_; }

  struct Found {
    CheckpointHead head;
    std::vector<std::uint8_t> state;
  };
  // The newest that is whole and of this configuration and mission. `said` receives a line for each file that
  // was passed over, with the reason.
  [[nodiscard]] std::optional<Found> readNewest(std::uint64_t configuration, std::uint64_t mission,
                                                std::vector<std::string>& said) const;
  void remove(std::uint64_t number) noexcept;
  // Forgets both: a new mission begins, or the program cannot use them.
  void remove() noexcept;

  [[nodiscard]] std::filesystem::path file(std::uint64_t number) const;
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

 private:
  std::filesystem::path folder_;
  std::string error_;
};

// Reads a checkpoint from bytes that may be anything; an empty string, or why it is none. `most`: of the
// state [B].
[[nodiscard]] std::string decodeCheckpoint(std::span<const std::uint8_t> bytes, CheckpointHead& head,
                                           std::span<const std::uint8_t>& state);

}  // namespace fathom::onboard
