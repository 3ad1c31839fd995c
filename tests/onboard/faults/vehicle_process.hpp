#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tests/onboard/faults/vehicle.hpp"
#include "tests/support/mapped_file.hpp"

namespace fathom::test {

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
