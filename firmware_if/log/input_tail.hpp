#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "firmware_if/log/onboard_input.hpp"

namespace fathom::io {

// The newest part of a mission's log, for a quick start again behind a checkpoint: read from the end
// backwards, in growing pieces, until the mark is found, so that five hours of log cost no more than what
// lies behind the mark.
struct InputTail {
  bool mark_found = false;
  std::vector<OnboardInput> inputs;  // behind the newest mark kCheckpoint `number`, or all when not found
  std::uint64_t damaged = 0;         // entries skipped
};

// `number` 0: every input of the log. `mark_utc_ns`: when the mark was given, if that is known; behind what
// is older nobody looks for it, and the inputs of one that is not there are then the newest ones only. Throws
// InputError if the log is absent, empty, or cannot be read to its end.
[[nodiscard]] InputTail readInputTail(const std::filesystem::path& mission_folder, std::uint64_t number,
                                      std::int64_t mark_utc_ns = INT64_MIN);

}  // namespace fathom::io
