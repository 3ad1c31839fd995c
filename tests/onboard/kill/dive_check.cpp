#include "tests/onboard/kill/dive_check.hpp"

#include <algorithm>

namespace fathom::test {

LoggedInputs::LoggedInputs(const std::filesystem::path& dive, const Playback& played) : played_(played) {
  std::uint64_t damaged = 0;
  for (const io::OnboardInput& input : io::readOnboardInputs(dive, damaged))
    if (const auto* sample = std::get_if<SensorSample>(&input.what)) logged_.insert(keyOf(*sample));
}

double LoggedInputs::oldestLost(const DiveLife& life) const {
  if (life.navigates_ns == 0 || !life.first) return 0;
  for (std::size_t i = *life.first; const auto step = played_.at(i); ++i) {
    if (step->due_ns >= life.ended_utc_ns) return 0;
    if (step->due_ns < life.navigates_utc_ns) continue;
    if (step->sample && logged_.count(keyOf(*step->sample)) == 0)
      return static_cast<double>(life.ended_utc_ns - step->due_ns) * 1e-9;
  }
  return 0;
}

std::optional<DiveState> newestStateUntil(const std::vector<DiveLife>& lives, std::int64_t utc_ns) {
  std::optional<DiveState> newest;
  for (const DiveLife& life : lives)
    for (const DiveState& state : life.states)
      if (state.utc_ns <= utc_ns) newest = state;
  return newest;
}

bool holdsAllOf(const DiveState& now, const DiveState& before) {
  return now.pairs >= before.pairs && now.keyframes >= before.keyframes && now.arrived >= before.arrived;
}

}  // namespace fathom::test
