#include "tests/onboard/faults/fault_dive.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"
#include "tests/onboard/faults/damage.hpp"
#include "tests/onboard/faults/dive_judge.hpp"
#include "tests/onboard/faults/vehicle_process.hpp"
#include "tests/support/bad_parts.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using onboard::MapperPhase;

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
           seen().phase == static_cast<std::uint32_t>(MapperPhase::kRunning) && seen().mapper > 0 &&
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
