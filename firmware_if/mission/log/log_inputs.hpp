#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"

namespace fathom::io {

// Walks the inputs of a mission's log forward, each with its position: the number of inputs that were offered
// to the recorder before it, in all runs of the program. Inputs that the log says are missing (FATHOM_GAP)
// and those with a damaged entry have positions too; decisions have none. In a stretch damaged so far that
// its entries are no longer found, the inputs are not counted (damaged()).
//
// The log may be absent, empty, or being written: then it ends where it ends now, and next() may be called
// again later. Memory: one entry and at most 1 MiB read ahead, however long the log is.
class LogInputReader {
 public:
  // Stands at the beginning of the log, position 0.
  explicit LogInputReader(const std::filesystem::path& mission_folder);

  // Continues behind the newest mark kCheckpoint `number`; the next input there has the given position. The
  // mark is searched for from the end of the log backwards, in growing pieces, so that of five hours only the
  // part behind it is read, and no further than inputs older than `mark_utc_ns`, the time of the mark. False
  // when the log does not hold it; then the reader stays where it is. Throws InputError when the log cannot
  // be read there.
  [[nodiscard]] bool seekBehindMark(std::uint64_t number, std::uint64_t position,
                                    std::int64_t mark_utc_ns = INT64_MIN);

  enum class Step : std::uint8_t {
    kInput,
    kDecision,
    kMissing,     // `missing` inputs from `position` on are not in the log
    kEnd,         // nothing more, yet
    kUnreadable,  // the disk refuses, failure() says why; the next call tries again from there
  };
  struct Entry {
    std::uint64_t position = 0;  // of the input; of a decision, that of the input that comes next
    OnboardInput input;
    std::uint64_t missing = 0;
  };
  [[nodiscard]] Step next(Entry& entry);

  // Of the input that comes next.
  [[nodiscard]] std::uint64_t position() const { return position_; }
  // Entries and stretches of the log that could not be read, since the beginning or the mark.
  [[nodiscard]] std::uint64_t damaged() const {
    return damaged_entries_ + (events_ ? events_->damagedStretches() : 0);
  }
  [[nodiscard]] const std::string& failure() const { return failure_; }

 private:
  // false: absent or empty, or failure() is set.
  [[nodiscard]] bool open();
  [[nodiscard]] Step missing(Entry& entry, std::uint64_t count);

  std::filesystem::path log_;
  std::unique_ptr<LogEventReader> events_;
  std::uint64_t position_ = 0, damaged_entries_ = 0;
  std::string failure_;
};

}  // namespace fathom::io
