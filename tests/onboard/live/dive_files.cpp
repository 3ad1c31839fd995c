#include "tests/onboard/live/dive_files.hpp"

#include <set>

#include "realtime/onboard/replay.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::test {

namespace fs = std::filesystem;

namespace {

std::set<std::string> filesIn(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

}  // namespace

InputKey keyOf(const SensorSample& sample) {
  const auto* image = std::get_if<ImageEvent>(&sample);
  const std::int64_t utc_ns = std::visit([](const auto& s) { return s.utc_ns; }, sample);
  return InputKey{sample.index(), image != nullptr ? static_cast<int>(image->side) : 0, utc_ns};
}

std::vector<std::string> replayDifferences(const fs::path& dive, const fs::path& config,
                                           const fs::path& again) {
  onboard::ReplayOptions options{.mission = dive, .config = config, .out = again, .link = {}};
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
