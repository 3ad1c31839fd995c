#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "sim/hil/bench/child_process.hpp"
#include "sim/hil/players/vehicle_clock.hpp"

namespace fathom::sim {

// The program that a bench run tests, with what a script does to its processes. Killed as a whole, it is
// started again at once on the same folder, as the unit does; each life has an output file of its own.
class ProgramUnderTest {
 public:
  enum class Process : std::uint8_t { kVehicle, kMapper };
  // Of the vehicle process: dead or stopped, and until it navigates again; 0: not yet.
  struct Away {
    std::int64_t from_utc_ns = 0, until_utc_ns = 0;
  };

  // Starts it. Throws std::runtime_error when it cannot be started.
  ProgramUnderTest(ChildProcess::Options options, const VehicleClock& clock);

  [[nodiscard]] bool waitUntilArmed(double seconds, const std::atomic<bool>& stop);
  // False when it ended by itself. To be asked some times a second: starts it again where it was killed.
  [[nodiscard]] bool running();
  void signal(int number);
  [[nodiscard]] std::optional<int> wait(double seconds);

  // Kills (SIGKILL), stops (SIGSTOP) or lets go on (SIGCONT) one of its processes, from any thread; false
  // where there is no such process now.
  [[nodiscard]] bool tell(Process process, int signal);
  [[nodiscard]] std::vector<Away> away();

 private:
  [[nodiscard]] std::optional<pid_t> mapper() const;

  ChildProcess::Options options_;
  const VehicleClock& clock_;
  std::mutex mutex_;
  std::unique_ptr<ChildProcess> child_;
  int lives_ = 1;
  bool killed_ = false;
  std::vector<Away> away_;
};

}  // namespace fathom::sim
