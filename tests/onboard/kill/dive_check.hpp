#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "tests/onboard/kill/dive_process.hpp"
#include "tests/onboard/live/dive_files.hpp"

namespace fathom::test {

// What the log of the dive holds of the mission that was played.
class LoggedInputs {
 public:
  // Throws InputError.
  LoggedInputs(const std::filesystem::path& dive, const Playback& played);

  // How long before the end of that life the oldest input came that it was given and the log does not hold
  // [s]; 0 when it holds all. What was due before it navigates does not count: it comes at once when the
  // devices start, as of no device, and may be more than its queue holds.
  [[nodiscard]] double oldestLost(const DiveLife& life) const;

 private:
  std::set<InputKey> logged_;
  const Playback& played_;
};

// The newest state that any of the lives reported, among those until then; none if there is none so old.
[[nodiscard]] std::optional<DiveState> newestStateUntil(const std::vector<DiveLife>& lives,
                                                        std::int64_t utc_ns);
// Nothing of it is less; the map may take fewer tiles when its meshes have moved.
[[nodiscard]] bool holdsAllOf(const DiveState& now, const DiveState& before);

}  // namespace fathom::test
