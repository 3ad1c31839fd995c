#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
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

// Steps the system's clock for one program: a preloaded library replaces clock_gettime, gettimeofday, time
// and timespec_get and adds this object's offset to CLOCK_REALTIME. (Linux time namespaces cover the
// monotonic clocks only, and setting the machine's clock would affect every other program.) Sleeps to an
// absolute CLOCK_REALTIME keep their length.
class SteppedClock {
 public:
  // Creates the file `shared`, from which the program reads the offset. Throws std::runtime_error.
  explicit SteppedClock(const std::filesystem::path& shared);
  ~SteppedClock();
  SteppedClock(const SteppedClock&) = delete;
  SteppedClock& operator=(const SteppedClock&) = delete;

  // Environment variables for the program; empty without the library.
  [[nodiscard]] std::vector<std::string> environment() const;
  void step(double seconds);

 private:
  std::filesystem::path shared_;
  std::int64_t* offset_ns_ = nullptr;
};

}  // namespace fathom::sim
