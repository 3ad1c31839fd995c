#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "firmware_if/log/log_messages.hpp"

namespace fathom::io {

// What a live recorder had to leave out, logged in the place where it would have been; channel FATHOM_GAP,
// fathom.gap_t. What it means for a replay of the log:
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
  // for decisions, kGapOfMapper for inputs that the log may have, but the mapper went on without.
  std::string what;
};

inline constexpr std::string_view kGapChannel = "FATHOM_GAP", kGapOfDecisions = "decisions",
                                  kGapOfMapper = "mapper";

[[nodiscard]] LogMessage encodeGap(const RecordingGap& gap);
// std::nullopt when fingerprint, length or CRC is wrong.
[[nodiscard]] std::optional<RecordingGap> decodeGap(std::span<const std::uint8_t> data);

// How much a log says that it misses.
struct RecordingGaps {
  std::uint64_t images = 0, raw_entries = 0, inputs = 0;
};
// Zero where there is no log. Throws InputError for one that cannot be read.
[[nodiscard]] RecordingGaps readGaps(const std::filesystem::path& mission_folder);

}  // namespace fathom::io
