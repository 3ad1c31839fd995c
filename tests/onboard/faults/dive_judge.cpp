#include "tests/onboard/faults/dive_judge.hpp"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <exception>
#include <set>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/onboard/replay.hpp"
#include "tests/onboard/faults/damage.hpp"
#include "tests/onboard/live/dive_files.hpp"
#include "tests/onboard/live/dived_mission.hpp"
#include "tests/support/recording_gaps.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

constexpr double kBack_s = 3, kEnd_s = 5, kLost_s = 1, kLate_s = 0.2;
constexpr double kSupervisorAway_s = 6 / kRate;  // it may wait for the system for so long
constexpr double kFinishing_s =
    30 / kRate;  // that a mapper that makes the end of its map may give no sign of life
constexpr double kDiskLook_s =
    5 / kRate;  // a mapper that lost rows looks so often for a disk that takes them
constexpr std::int64_t kInTransit_ns = 400'000'000;  // an input that was due so shortly before the end

class Verdict {
 public:
  void require(bool good, const std::string& what) {
    if (!good) bad_ += (bad_.empty() ? "" : "; ") + what;
  }
  [[nodiscard]] const std::string& bad() const { return bad_; }

 private:
  std::string bad_;
};

std::int64_t vehicleNs(double machine_s) {
  return static_cast<std::int64_t>(machine_s * kRate * 1e9);
}

std::string seconds(double s) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f s", s);
  return text;
}

// From when until when nothing that was played need be in the log.
struct Window {
  std::int64_t from_ns, to_ns;
};
std::vector<Window> lossWindows(const FaultCase& fault, const DiveStory& story) {
  std::vector<Window> windows;
  for (const VehicleProcess::Away& away : story.away)
    windows.push_back({away.from_ns - vehicleNs(kLost_s), away.to_ns == 0 ? INT64_MAX : away.to_ns});
  // From the fault itself, whenever it was seen: what comes to a part that hangs cannot be had before
  // somebody has found out.
  if (fault.endsVehicle() && !windows.empty())
    windows.push_back({story.fault_ns - vehicleNs(kLost_s), windows.front().to_ns});
  return windows;
}

std::optional<InputKey> shiftedKey(const io::OnboardInput& input, std::int64_t shift_ns) {
  const auto* sample = std::get_if<SensorSample>(&input.what);
  if (sample == nullptr) return std::nullopt;
  InputKey key = keyOf(*sample);
  key.utc_ns += shift_ns;
  return key;
}

void judgeInputs(const FaultCase& fault, const DiveStory& story, const VehicleSeen& seen,
                 const VehiclePlaces& places, Verdict& verdict) {
  std::uint64_t damaged = 0;
  std::set<InputKey> logged;
  std::int64_t first_ns = INT64_MAX;
  for (const io::OnboardInput& input : io::readOnboardInputs(places.dive(), damaged)) {
    if (const auto key = shiftedKey(input, 0)) {
      logged.insert(*key);
      first_ns = std::min(first_ns, input.arrival_utc_ns);
    }
  }
  const std::vector<Window> windows = lossWindows(fault, story);
  int inputs = 0, images = 0;
  std::int64_t oldest_ns = 0, newest_ns = 0;
  for (const io::OnboardInput& input : io::readOnboardInputs(places.mission, damaged)) {
    const std::int64_t due_ns = input.arrival_utc_ns + seen.shift_ns;
    const auto key = shiftedKey(input, seen.shift_ns);
    if (!key || due_ns < first_ns || due_ns > story.end_ns - kInTransit_ns || logged.count(*key) > 0)
      continue;
    if (std::any_of(windows.begin(), windows.end(),
                    [&](const Window& w) { return due_ns >= w.from_ns && due_ns <= w.to_ns; }))
      continue;
    ++(io::imageOf(input) != nullptr ? images : inputs);
    if (oldest_ns == 0) oldest_ns = due_ns;
    newest_ns = due_ns;
  }
  const auto afterFault = [&](std::int64_t ns) {
    return seconds(static_cast<double>(ns - story.fault_ns) * 1e-9 / kRate);
  };
  const std::string when =
      ", from " + afterFault(oldest_ns) + " to " + afterFault(newest_ns) + " after the fault";
  const bool log_hit = fault.disk.path == "sensors.lcmlog" || fault.is("map", PartFault::kCorrupt);
  verdict.require(inputs == 0 || log_hit, std::to_string(inputs) + " inputs were not logged" + when);
  verdict.require(images == 0 || log_hit || fault.disk.path == "img/",
                  std::to_string(images) + " images were not recorded" + when);
}

void judgeReplay(const FaultCase& fault, const VehiclePlaces& places, Verdict& verdict) {
  const test::RecordingGaps gaps = test::readGaps(places.dive());
  const std::vector<std::string> differ = replayDifferences(places.dive());
  std::string names;
  for (const std::string& name : differ) names += " " + name;
  verdict.require(differ.empty() || gaps.images + gaps.inputs > 0 || replaysToOther(fault),
                  "the replay differs:" + names);
}

// How long a part is taken for one that only waits.
double foundOutAfter(const FaultCase& fault) {
  if (fault.is("supervisor", PartFault::kHang)) return kSupervisorAway_s;
  if (fault.is("supervisor", PartFault::kCorrupt)) return kStuckAfter_s;
  if (!fault.hangs()) return 0;
  if (fault.process == PartOf::kMapper || fault.is("navigation", PartFault::kHang)) return kStuckAfter_s;
  // Until it is said that it is stuck, and as long again.
  return 2 * (std::strstr(fault.part, "camera") != nullptr ? kCameraAway_s : kStuckAfter_s);
}

}  // namespace

std::string judge(const FaultCase& fault, const DiveStory& story, const VehicleSeen& seen,
                  const VehiclePlaces& places) {
  Verdict verdict;
  verdict.require(story.mapped, "it never mapped");
  double back_s = kBack_s + story.waited_back_s + foundOutAfter(fault);
  if (fault.disk.fault != DiskFault::kNone) back_s += kDiskLook_s;
  verdict.require(story.back && story.back_s <= back_s,
                  (story.back ? "back too late, more than " : "not back after ") + seconds(back_s));
  verdict.require(story.saves || fault.hangs(), "no state was saved any more");
  const std::size_t ends = fault.endsVehicle() ? 1 : 0;
  for (std::size_t i = ends; i < story.away.size(); ++i)
    verdict.require(false, "the vehicle process ended (" + story.away[i].how + ")");
  const bool at_end = fault.hangs() && std::strcmp(fault.part, "output") == 0;
  const double end_s = kEnd_s + story.waited_end_s + (at_end ? kFinishing_s : 0);
  verdict.require(story.ended && story.end_s <= end_s, "no end within " + seconds(end_s));
  verdict.require(seen.mapped, "no map");
  verdict.require(seen.wild_poses == 0, "the pose jumped");
  const bool slow = fault.is("navigation", PartFault::kSlow),
             stops = fault.is("navigation", PartFault::kHangShort);
  const double late_s = kLate_s + story.navigation_waited_s + (slow || stops ? 1e-3 * kFaultFor_ms : 0);
  verdict.require(seen.skipped_s <= late_s, "navigation was late by more than " + seconds(late_s));
  try {
    judgeInputs(fault, story, seen, places, verdict);
    if (seen.mapped) judgeReplay(fault, places, verdict);
  } catch (const std::exception& e) {
    verdict.require(false, e.what());
  }
  return verdict.bad();
}

}  // namespace fathom::test
