#include "realtime/onboard/live/hung_restarts.hpp"

#include <algorithm>
#include <fstream>
#include <stdexcept>
#include <string>

#include "recon/geometry/atomic_file.hpp"

namespace fathom::onboard {
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
