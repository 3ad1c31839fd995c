#include "tests/onboard/live/dived_mission.hpp"

#include <algorithm>

namespace fathom::test {

namespace fs = std::filesystem;
using namespace onboard;

static constexpr double kFrom_s = 37;  // in reef-quick: the seafloor comes into sight

DivedMission::DivedMission(fs::path mission)
    : mission_(std::move(mission)),
      clock_(rt::VehicleClock::systemOffsetNs(), kRate),
      played_(mission_, clock_, kLead_s * kRate - kFrom_s) {}

std::unique_ptr<LiveSystem> DivedMission::start(const fs::path& folder, bool clear_folder,
                                                const std::string& more, double stuck_after_s) {
  LiveSetup setup = liveSetup(mission_, folder, clear_folder, more, stuck_after_s);
  const std::int64_t now = clock_.utcNs();
  for (played_.first = 0; played_.first < played_.inputs.size() && played_.dueNs(played_.first) < now;)
    ++played_.first;
  LiveDevices devices = playedDevices(played_, mission_, setup.mission, setup.rig, clock_, {});
  return std::make_unique<LiveSystem>(std::move(setup), std::move(devices), clock_);
}

bool DivedMission::superviseUntil(LiveSystem& live, const std::function<bool()>& done, double most_s) {
  constexpr std::int64_t kBetweenLooks_ns = 50'000'000;
  const std::int64_t end = clock_.utcNs() + static_cast<std::int64_t>(most_s * 1e9);
  while (!done()) {
    if (clock_.utcNs() >= end) return false;
    for (std::string& event : live.supervise()) said_.push_back(std::move(event));
    clock_.sleepUntil(clock_.monotonicNs() + static_cast<std::int64_t>(kRate * kBetweenLooks_ns));
  }
  return true;
}

double DivedMission::leftSeconds() const {
  return static_cast<double>(played_.dueNs(played_.inputs.size() - 1) - clock_.utcNs()) * 1e-9;
}

bool DivedMission::saidThat(const std::string& what) const {
  return std::any_of(said_.begin(), said_.end(),
                     [&](const std::string& line) { return line.find(what) != std::string::npos; });
}

}  // namespace fathom::test
