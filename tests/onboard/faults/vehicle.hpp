#pragma once

#include <sys/types.h>

#include <atomic>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "realtime/kernel/time/vehicle_clock.hpp"
#include "tests/support/mapped_file.hpp"

namespace fathom::test {

// The vehicle's time in these dives runs so much faster.
inline constexpr double kRate = 2;
// [realtime] stuck_after_s of them, in seconds of the machine.
inline constexpr double kStuckAfter_s = 1.5;
// A camera's thread may be away for so long, looking for it, of the machine.
inline constexpr double kCameraAway_s = 10 / kRate;

// What the judge and the vehicle process share, over all lives of the vehicle.
struct VehicleSeen {
  // By the judge.
  rt::VehicleClock::Setting clock;
  std::atomic<bool> end{false};  // the dive is to end
  // By the vehicle. Added to the mission's times gives the vehicle's: it begins when the first life is armed.
  std::atomic<std::int64_t> shift_ns{0};
  std::atomic<std::uint64_t> lives{0};          // that were armed
  std::atomic<std::int64_t> armed_utc_ns{0};    // of the newest life
  std::atomic<std::uint64_t> beats{0};          // of navigation, as it goes
  std::atomic<std::uint32_t> phase{0};          // of the mapper
  std::atomic<std::int32_t> mapper{0};          // its process
  std::atomic<std::uint64_t> mapper_starts{0};  // of the newest life
  std::atomic<std::uint64_t> pairs{0};          // mapped or left out
  std::atomic<std::int64_t> lag_ns{0};
  std::atomic<std::uint64_t> wild_poses{0};  // not finite, or that jumped
  // When the dive has ended.
  std::atomic<bool> ended{false}, mapped{false};
  std::atomic<double> end_s{0};
  std::atomic<double> skipped_s{0};  // that navigation's cycles came too late, of the newest life [s]
};

struct VehiclePlaces {
  std::filesystem::path mission, out;
  [[nodiscard]] std::filesystem::path dive() const { return out / "dive"; }
  [[nodiscard]] std::filesystem::path config() const { return out / "dive.toml"; }
  [[nodiscard]] std::filesystem::path seen() const { return out / "seen"; }
  [[nodiscard]] std::filesystem::path parts() const { return out / "bad-parts"; }
};
// mission.toml and stereo.calib of the dive, and its configuration.
void prepareDive(const VehiclePlaces& places);

// The vehicle process of one life: LiveSystem with devices played from the mission, as fathom-onboard has it,
// until VehicleSeen::end. Exit status.
int runVehicle(const VehiclePlaces& places);

// How long programs were ready to run and waited for a processor, what a busy machine took from them: main
// threads and the mapper's vision, which do their work one after the other where a program starts.
class WaitedForCpu {
 public:
  void look(pid_t process);
  // All of them since the last begin() [s].
  [[nodiscard]] double all() const;
  // Navigation's threads, ever.
  [[nodiscard]] double ofNavigation() const;
  void begin();

 private:
  struct Thread {
    std::string name;
    double now = 0, begin = 0;
  };
  std::map<pid_t, Thread> threads_;
};

// The vehicle process as the system's service manager keeps it (realtime/onboard/service): started again 0.1
// s after it ended, and killed when it gives no sign of life for WatchdogSec.
class VehicleProcess {
 public:
  // `prepare` is called in each life before the program begins.
  VehicleProcess(const VehiclePlaces& places, std::function<void()> prepare);
  ~VehicleProcess();
  VehicleProcess(const VehicleProcess&) = delete;
  VehicleProcess& operator=(const VehicleProcess&) = delete;

  // Some times a second.
  void look();
  [[nodiscard]] VehicleSeen& seen() { return *seen_; }
  [[nodiscard]] bool runs() const { return pid_ > 0; }
  [[nodiscard]] pid_t pid() const { return pid_; }
  // Vehicle's time when a life ended, and when the next was armed; 0: not yet.
  struct Away {
    std::int64_t from_ns = 0, to_ns = 0;
    std::string how;
  };
  [[nodiscard]] const std::vector<Away>& away() const { return away_; }
  [[nodiscard]] rt::VehicleClock& clock() { return clock_; }
  [[nodiscard]] WaitedForCpu& waited() { return waited_; }

 private:
  void start();
  void readSigns();

  VehiclePlaces places_;
  std::function<void()> prepare_;
  rt::VehicleClock clock_;
  MappedFile<VehicleSeen> seen_;
  WaitedForCpu waited_;
  int notify_ = -1;
  std::string notify_name_;
  pid_t pid_ = -1;
  std::uint64_t lives_ = 0;
  std::int64_t last_sign_ns_ = 0, start_at_ns_ = 0;  // of the machine
  bool armed_ = false, killed_ = false;
  std::vector<Away> away_;
};

}  // namespace fathom::test
