#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "sim/hil/bench/child_process.hpp"
#include "sim/hil/players/simulated_vehicle_clock.hpp"

namespace fathom::sim {

// The program under test with the faults of its processes. Killed by a fault, it is restarted at once on the
// same folder, as by its systemd unit; each start has an output file of its own.
class ProgramUnderTest {
 public:
  enum class Process : std::uint8_t { kVehicle, kMapper };
  // Time without the vehicle process, until it is armed again (0: not yet).
  struct Outage {
    std::int64_t from_utc_ns = 0, until_utc_ns = 0;
  };

  // Starts it. Throws std::runtime_error when it cannot be started.
  ProgramUnderTest(ChildProcess::Options options, const SimulatedVehicleClock& clock);

  [[nodiscard]] bool waitUntilArmed(double seconds, const std::atomic<bool>& stop);
  // False when it ended by itself; restarts it after a kill. To be polled several times a second.
  [[nodiscard]] bool running();
  void signal(int number);
  [[nodiscard]] std::optional<int> wait(double seconds);

  // Kills (SIGKILL), stops (SIGSTOP) or continues (SIGCONT) one of its processes; false without such a
  // process. Thread-safe.
  [[nodiscard]] bool signalProcess(Process process, int signal);
  [[nodiscard]] std::vector<Outage> outages();

 private:
  [[nodiscard]] std::optional<pid_t> mapper() const;

  ChildProcess::Options options_;
  const SimulatedVehicleClock& clock_;
  std::mutex mutex_;
  std::unique_ptr<ChildProcess> child_;
  int starts_ = 1;
  bool killed_ = false;
  std::vector<Outage> outages_;
};

}  // namespace fathom::sim
