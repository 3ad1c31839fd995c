#include "tests/onboard/kill/dive_check.hpp"

#include <algorithm>

#include "realtime/onboard/replay.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

std::set<std::string> filesIn(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

}  // namespace

LoggedInputs::Key LoggedInputs::keyOf(const SensorSample& sample) {
  const auto* image = std::get_if<ImageEvent>(&sample);
  const std::int64_t utc_ns = std::visit([](const auto& s) { return s.utc_ns; }, sample);
  return Key{sample.index(), image != nullptr ? static_cast<int>(image->side) : 0, utc_ns};
}

LoggedInputs::LoggedInputs(const fs::path& dive, const Playback& played) : played_(played) {
  std::uint64_t damaged = 0;
  for (const io::OnboardInput& input : io::readOnboardInputs(dive, damaged))
    if (const auto* sample = std::get_if<SensorSample>(&input.what)) logged_.insert(keyOf(*sample));
}

double LoggedInputs::oldestLost(const DiveLife& life) const {
  if (life.navigates_ns == 0 || !life.first) return 0;
  for (std::size_t i = *life.first; const auto step = played_.at(i); ++i) {
    if (step->due_ns >= life.ended_utc_ns) return 0;
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

std::vector<std::string> differencesToReplay(const fs::path& dive, const fs::path& config,
                                             const fs::path& again) {
  onboard::ReplayOptions options;
  options.mission = dive;
  options.config = config;
  options.out = again;
  (void)onboard::replay(options);
  // What a clock measured.
  const std::set<std::string> measured = {"timing.json", "live.json"};
  const fs::path onboard = dive / "onboard";
  std::set<std::string> names = filesIn(onboard);
  names.merge(filesIn(again));
  std::vector<std::string> different;
  for (const std::string& name : names)
    if (measured.count(name) == 0 && (!fs::exists(onboard / name) || !fs::exists(again / name) ||
                                      readText(onboard / name) != readText(again / name)))
      different.push_back(name);
  return different;
}

}  // namespace fathom::test
