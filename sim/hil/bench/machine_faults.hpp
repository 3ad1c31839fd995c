#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "sim/hil/bench/program_under_test.hpp"
#include "sim/hil/bench/recording_disk.hpp"
#include "sim/hil/bench/stepped_clock.hpp"
#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/simulated_vehicle_clock.hpp"

namespace fathom::sim {

// Threads of ordinary priority that compute and never sleep.
class CpuHog {
 public:
  CpuHog() = default;
  ~CpuHog() { stop(); }
  CpuHog(const CpuHog&) = delete;
  CpuHog& operator=(const CpuHog&) = delete;

  void start(int threads) {
    stop_ = false;
    for (int i = 0; i < threads; ++i)
      threads_.emplace_back([this] {
        while (!stop_.load(std::memory_order_relaxed)) continue;
      });
  }
  void stop() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }

 private:
  std::atomic<bool> stop_{false};
  std::vector<std::thread> threads_;
};

// Injects the script's faults of the computer and of the program's processes: disk_full, cpu_hog, clock_step,
// and those of mapper and vehicle. Each ends with its time, at the latest when run() returns.
class MachineFaults {
 public:
  // Without `disk`, `stepped` or `program` (nullptr), notes() lists their faults as not injected.
  MachineFaults(const MissionSchedule& schedule, const FaultScript& script, SimulatedVehicleClock& clock,
                RecordingDisk* disk, SteppedClock* stepped, ProgramUnderTest* program);

  void run(const std::atomic<bool>& stop);
  // Injected counts by kind, after run(); clock steps include those back.
  [[nodiscard]] const std::array<std::uint64_t, kFaultKinds>& done() const { return done_; }
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  void begin(const Fault& fault);
  void end(const Fault& fault);

  const MissionSchedule& schedule_;
  FaultScript script_;
  SimulatedVehicleClock& clock_;
  RecordingDisk* disk_;
  SteppedClock* stepped_;
  ProgramUnderTest* program_;
  CpuHog hog_;
  std::array<std::uint64_t, kFaultKinds> done_{};
  std::vector<std::string> notes_;
};

}  // namespace fathom::sim
