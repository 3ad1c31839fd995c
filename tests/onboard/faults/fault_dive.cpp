#include <sys/stat.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <set>

#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"
#include "realtime/onboard/replay.hpp"
#include "tests/onboard/faults/fault_case.hpp"
#include "tests/onboard/faults/vehicle.hpp"
#include "tests/onboard/live/dive_files.hpp"
#include "tests/onboard/live/dived_mission.hpp"
#include "tests/support/bad_parts.hpp"
#include "tests/support/recording_gaps.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;

// What happened in one dive; times of the vehicle, or seconds of the machine.
struct DiveStory {
  bool mapped = false, back = false, ended = false;
  bool saves = true;  // states, after a fault of what saves them
  std::int64_t fault_ns = 0, back_ns = 0, end_ns = 0;
  double fault_s = 0;  // that it took to do the fault
  double back_s = 0;   // from then until navigation ran and the map followed
  double end_s = 0;
  // What the machine took from the programs meanwhile, and from navigation's thread at all.
  double waited_back_s = 0, waited_end_s = 0, navigation_waited_s = 0;
  std::vector<VehicleProcess::Away> away;
};

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
  const RecordingGaps gaps = readGaps(places.dive());
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

// What is wrong with it; "" where nothing is. Replays the dive.
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

constexpr double kLook_s = 0.04;
constexpr std::uint64_t kPairsBefore = 3;
constexpr double kSaves_s = 5;                      // that are waited for a saved state
constexpr double kMapping_s = 120, kGiveUp_s = 45;  // that are waited for anything at most

double now() {
  return static_cast<double>(rt::RealClock().monotonicNs()) * 1e-9;
}

class FaultDive {
 public:
  FaultDive(const VehiclePlaces& places, const FaultCase& fault, unsigned seed)
      : places_(places),
        fault_(fault),
        seed_(seed),
        disk_(places.dive()),
        parts_(places.parts()),
        vehicle_(places, [this] { prepareVehicle(); }) {
    disk_.use(false);
    std::uint64_t damaged = 0;
    for (const io::OnboardInput& input : io::readOnboardInputs(places.mission, damaged))
      if (io::imageOf(input) != nullptr) last_image_ns_ = input.arrival_utc_ns;
  }

  DiveStory run() {
    DiveStory story;
    story.mapped = until([&] { return seen().pairs >= kPairsBefore && follows(); }, kMapping_s);
    rest(fault_.after_s);
    vehicle_.waited().begin();
    story.fault_ns = vehicle_.clock().utcNs();
    const double begin = now();
    doFault();
    const double over = now();
    story.fault_s = over - begin;
    const std::uint64_t pairs = seen().pairs;
    const auto restarted = [&] { return !fault_.endsVehicle() || !vehicle_.away().empty(); };
    story.back =
        until([&] { return restarted() && follows() && (seen().pairs > pairs || imagesOver()); }, kGiveUp_s);
    story.back_s = now() - over;
    story.back_ns = vehicle_.clock().utcNs();
    story.waited_back_s = vehicle_.waited().all();
    if (std::strcmp(fault_.part, "checkpoints") == 0)
      story.saves = until([&] { return newestState() > story.back_ns; }, kSaves_s);
    end(story);
    story.away = vehicle_.away();
    return story;
  }
  [[nodiscard]] VehicleSeen& seen() { return vehicle_.seen(); }

 private:
  // The vehicle's own disk and parts are spoilt by calls in this program, its mapper's by a library.
  void prepareVehicle() {
    disk_.use(true);
    for (const std::string& variable : disk_.environment()) ::putenv(::strdup(variable.c_str()));  // NOLINT
    ::putenv(::strdup(parts_.environment().c_str()));  // NOLINT: the environment keeps it
  }
  bool until(const std::function<bool()>& done, double most_s) {
    const double end = now() + most_s;
    for (; !done(); rt::restFor(static_cast<std::int64_t>(kLook_s * 1e9))) {
      if (now() > end) return false;
      vehicle_.look();
    }
    return true;
  }
  void rest(double seconds) {
    (void)until([] { return false; }, seconds);
  }
  // Navigation runs and the map is no more than a second behind.
  bool follows() {
    const std::uint64_t beats = seen().beats;
    rt::restFor(static_cast<std::int64_t>(kLook_s * 1e9));
    vehicle_.look();
    return vehicle_.runs() && seen().beats > beats &&
           seen().lag_ns < static_cast<std::int64_t>(1e9 * kRate) &&
           seen().phase == static_cast<std::uint32_t>(onboard::MapperPhase::kRunning) && seen().mapper > 0 &&
           ::kill(seen().mapper, 0) == 0 && (vehicle_.away().empty() || vehicle_.away().back().to_ns > 0);
  }
  bool imagesOver() { return vehicle_.clock().utcNs() > last_image_ns_ + seen().shift_ns; }

  // Of the machine's clock for files, in the vehicle's time.
  std::int64_t newestState() {
    std::int64_t newest_ns = 0;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(places_.dive() / "state", error)) {
      struct stat file = {};
      if (entry.path().extension() != ".bin" || ::stat(entry.path().c_str(), &file) != 0) continue;
      const std::int64_t age_ns =
          rt::RealClock().utcNs() - (file.st_mtim.tv_sec * kSecond_ns + file.st_mtim.tv_nsec);
      newest_ns = std::max(newest_ns, vehicle_.clock().utcNs() - static_cast<std::int64_t>(kRate) * age_ns);
    }
    return newest_ns;
  }
  void doToMapper() {
    const pid_t mapper = seen().mapper;
    if (mapper <= 0) return;
    const auto stopFor = [&](double seconds) {
      ::kill(mapper, SIGSTOP);
      rest(seconds);
      ::kill(mapper, SIGCONT);
    };
    switch (fault_.fault) {
      case PartFault::kKill:
        ::kill(mapper, SIGKILL);
        return;
      case PartFault::kSegmentation:
        ::kill(mapper, SIGSEGV);
        return;
      case PartFault::kAbort:
        ::kill(mapper, SIGABRT);
        return;
      case PartFault::kHang:
        ::kill(mapper, SIGSTOP);
        return;
      case PartFault::kHangShort:
        return stopFor(1);
      case PartFault::kSlow:
        for (const double end = now() + 1e-3 * kFaultFor_ms; now() < end; rest(0.01)) stopFor(0.09);
        return;
      default:
        return;
    }
  }

  void doFault() {
    const bool whole_mapper = std::strcmp(fault_.part, "mapper") == 0;
    if (whole_mapper) {
      doToMapper();
    } else if (fault_.fault != PartFault::kNone) {
      if (fault_.fault == PartFault::kCorrupt) damage(fault_, places_.dive(), seen().mapper, seed_);
      parts_.set(fault_.part, fault_.fault, kFaultFor_ms);
    }
    const bool lasts = fault_.fault == PartFault::kSlow || fault_.fault == PartFault::kCorrupt ||
                       fault_.fault == PartFault::kHangShort;
    if (fault_.disk.fault != DiskFault::kNone) {
      rest(fault_.apart_s);
      disk_.set(fault_.disk);
      rest(1e-3 * kFaultFor_ms);
    } else if (lasts && !whole_mapper) {
      rest(1e-3 * kFaultFor_ms);
    } else if (!whole_mapper && std::strcmp(fault_.part, "output") != 0) {
      // At the next of its points.
      (void)until([&] { return parts_.hit(); }, kGiveUp_s);
    }
    disk_.clear();
  }

  void end(DiveStory& story) {
    vehicle_.waited().begin();
    story.end_ns = vehicle_.clock().utcNs();
    const double begin = now();
    seen().end = true;
    story.ended = until([&] { return !vehicle_.runs() && seen().ended; }, kGiveUp_s);
    story.end_s = now() - begin;
    story.waited_end_s = vehicle_.waited().all();
    story.navigation_waited_s = vehicle_.waited().ofNavigation();
    parts_.clear();
  }

  VehiclePlaces places_;
  FaultCase fault_;
  unsigned seed_;
  BadDisk disk_;
  BadParts parts_;
  VehicleProcess vehicle_;
  std::int64_t last_image_ns_ = 0;
};

}  // namespace

int faultDive(const fs::path& mission, const fs::path& out, unsigned seed, int number) {
  const FaultCase fault = faultCase(seed, number);
  const VehiclePlaces places{mission, out};
  prepareDive(places);
  FaultDive dive(places, fault, seed * 1000 + static_cast<unsigned>(number));
  const DiveStory story = dive.run();
  const std::string bad = judge(fault, story, dive.seen(), places);
  std::printf(
      "%s %s: fault %.1f s, back after %.1f s, end %.1f s, late %.2f s, %llu starts of the mapper, "
      "%zu of the vehicle%s%s\n",
      bad.empty() ? "good" : "BAD", fault.name().c_str(), story.fault_s, story.back_s, story.end_s,
      static_cast<double>(dive.seen().skipped_s),
      static_cast<unsigned long long>(dive.seen().mapper_starts.load()), story.away.size() + 1,
      bad.empty() ? "" : "; ", bad.c_str());
  return bad.empty() ? 0 : 1;
}

}  // namespace fathom::test
