#pragma once

#include <cstdint>

#include "firmware_if/files/mission.hpp"

namespace fathom::io {

// What an earlier run left in img/ beside what its log names.
struct FoundImages {
  std::uint64_t without_event = 0;  // whole, newer than the log's last events; kept
  std::uint64_t halves_removed = 0;
};

// Looks at the images that are newer than the end of the log, after the log was cut behind its last whole
// entry; removes halves ("*.tmp"). The log's older part is not read.
[[nodiscard]] FoundImages lookAtImages(const MissionPaths& paths);

}  // namespace fathom::io
