#include "realtime/onboard/live/program_watch.hpp"

#include <algorithm>
#include <fstream>
#include <stdexcept>
#include <string>

#include "realtime/base/files/atomic_file.hpp"

namespace fathom::onboard {
namespace {

std::string silent(const char* part, std::int64_t limit_ns) {
  return std::string(part) + " gave no sign of life for " + std::to_string(limit_ns / 1'000'000) + " ms";
}

}  // namespace

std::int64_t ProgramWatch::Life::look(std::int64_t now_ns, std::uint64_t now_beats) {
  if (now_beats != beats || last_ns == 0) last_ns = now_ns;
  beats = now_beats;
  return now_ns - last_ns;
}

std::string ProgramWatch::look(std::int64_t now_ns, std::uint64_t navigation_beats,
                               std::uint64_t supervisor_beats) {
  const std::int64_t navigation_ns = navigation_.look(now_ns, navigation_beats),
                     supervisor_ns = supervisor_.look(now_ns, supervisor_beats);
  alive_ = navigation_ns < config_.navigation_ns;
  if (!alive_) return silent("navigation", config_.navigation_ns);
  if (supervisor_ns >= config_.supervisor_ns) return silent("the supervisor", config_.supervisor_ns);
  return "";
}

namespace {

constexpr std::int64_t kLongest_ns = 600'000'000'000;
constexpr int kMostDoubled = 16;

}  // namespace

HungRestarts::HungRestarts(const std::filesystem::path& state_folder) : file_(state_folder / "hung.txt") {
  if (!(std::ifstream(file_) >> count_)) count_ = 0;
  count_ = std::clamp(count_, 0, kMostDoubled);
}

std::int64_t HungRestarts::patienceNs(std::int64_t limit_ns) const {
  // One limit until it is said that it is stuck, and another.
  return std::max(2 * limit_ns, std::min(limit_ns << (1 + count_), kLongest_ns));
}

bool HungRestarts::note() {
  try {
    writeFile(file_, std::to_string(count_ + 1) + "\n");
  } catch (const std::runtime_error&) {
    return false;
  }
  ++count_;
  return true;
}

bool HungRestarts::waitsForDisk() {
  std::error_code error;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task", error)) {
    std::string line;
    std::getline(std::ifstream(task.path() / "stat"), line);
    // "id (name) state"; a name may hold anything.
    const std::size_t name_end = line.rfind(')');
    if (name_end != std::string::npos && line.compare(name_end, 3, ") D") == 0) return true;
  }
  return false;
}

}  // namespace fathom::onboard
