#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// Everything that fathom-onboard's cores consume, in one order: the log of a live run holds exactly this
// sequence, so that it replays to the same bytes. Channels beside those of log_messages.hpp:
//
//   FATHOM_MODEM_IN   fathom.raw_t       a link frame that the modem received, by itself or in a bundle
//   FATHOM_TICK       fathom.tick_t      a tenth of a second has passed: health is checked, frames are sent
//   FATHOM_DECISION   fathom.decision_t  decision about a pair after a measured time or at a full queue
//   FATHOM_MARK       fathom.mark_t      a state was saved, the program started again, the survey ended, ...
//   FATHOM_GAP        fathom.gap_t       what the recorder left out, no input (RecordingGap)

// A link frame of at most 256 bytes; a modem frame may hold several.
struct ModemFrame {
  std::uint16_t size = 0;
  std::array<std::uint8_t, 256> bytes{};
  [[nodiscard]] std::span<const std::uint8_t> data() const { return {bytes.data(), size}; }
};

struct Tick {};

// What the soft tier decided about one stereo pair, logged at that time; replay looks it up by the pair.
struct Decision {
  std::uint32_t pair_index = 0;
  std::uint8_t level = 0;  // of degradation: 0 none (realtime/kernel/threads/overload_rule.hpp)
  bool dropped = false;    // the pair is not mapped
};

struct Mark {
  enum class Kind : std::uint8_t {
    kCheckpoint = 0,
    kRestart = 1,
    kEnd = 2,
    kHealth = 3,
    kMapperLost = 4,
    kSent = 5
  };
  // Number of a kRestart with an empty map: nothing mapped before could be continued.
  static constexpr std::uint64_t kEmptyMap = INT64_MAX;
  Kind kind = Kind::kEnd;
  // kCheckpoint: the state after all inputs before this mark may have been saved as `number`. kRestart: the
  // mapper came back with checkpoint `number`, consumed again what is logged behind its mark, and the
  //   link sends again; 0: from the beginning of the log; kEmptyMap: from there, but no pair before this mark
  //   is mapped.
  // kEnd: the survey is over. kHealth: health flags (telemetry's bits) of what the cores cannot see, from now
  // on: privileges, disk, overload. kMapperLost: the mapper has gone; from here on the link is silent. kSent:
  // frames up to before `number` have just been given to the modem.
  std::uint64_t number = 0;
};

// Owns no memory, so that it crosses the rings of the hard tier: copying never throws and never calls the
// heap.
struct OnboardInput {
  using What = std::variant<SensorSample, ModemFrame, Tick, Decision, Mark>;

  OnboardInput() noexcept = default;
  OnboardInput(std::int64_t arrival, const What& input) noexcept : arrival_utc_ns(arrival), what(input) {}
  OnboardInput(const OnboardInput&) noexcept = default;
  OnboardInput& operator=(const OnboardInput&) noexcept = default;

  std::int64_t arrival_utc_ns = 0;  // never falls within one run of the program
  What what = Tick{};
};

inline constexpr std::string_view kDecisionChannel = "FATHOM_DECISION", kMarkChannel = "FATHOM_MARK";

// The exposure that an input reports, or null.
[[nodiscard]] inline const ImageEvent* imageOf(const OnboardInput& input) noexcept {
  const auto* sample = std::get_if<SensorSample>(&input.what);
  return sample != nullptr ? std::get_if<ImageEvent>(sample) : nullptr;
}

[[nodiscard]] bool carriesInput(std::string_view channel);
[[nodiscard]] LogMessage encodeInput(const OnboardInput& input);
// std::nullopt for a channel that carries no input, or a message with a wrong fingerprint, length or CRC.
[[nodiscard]] std::optional<OnboardInput> decodeInput(std::string_view channel,
                                                      std::span<const std::uint8_t> data);

// Reads a mission's inputs in recorded order; where there is no log, those of the RAW.auv. Damaged entries
// are skipped and counted. Throws InputError if the file is absent, empty, holds no sample at all, or cannot
// be read to its end.
[[nodiscard]] std::vector<OnboardInput> readOnboardInputs(const std::filesystem::path& mission_folder,
                                                          std::uint64_t& damaged);

// An omission of a live recorder, logged in its place; channel FATHOM_GAP, fathom.gap_t. Effect on a replay
// of the log:
//   kImage   the event of the exposure follows and is replayed, its file is not there: navigation replays to
//            the same bytes, the map misses a pair that the vehicle may have mapped
//   kRaw     bytes or messages that no core consumes: the replay is the same
//   kInputs  inputs that the cores consumed: from here on the replay differs from what the vehicle did
struct RecordingGap {
  enum class Kind : std::uint8_t { kImage = 0, kRaw = 1, kInputs = 2 };
  std::int64_t arrival_utc_ns = 0;  // of what follows in the log
  Kind kind = Kind::kInputs;
  std::uint64_t count = 0;
  // The image's file name. Of kInputs: empty for inputs that the log misses in this place, kGapOfDecisions
  // for decisions, kGapOfMapper for inputs that the log may have but the mapper did not consume.
  std::string what;
};

inline constexpr std::string_view kGapChannel = "FATHOM_GAP", kGapOfDecisions = "decisions",
                                  kGapOfMapper = "mapper";

[[nodiscard]] LogMessage encodeGap(const RecordingGap& gap);
// std::nullopt when fingerprint, length or CRC is wrong.
[[nodiscard]] std::optional<RecordingGap> decodeGap(std::span<const std::uint8_t> data);

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
