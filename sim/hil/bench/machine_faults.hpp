#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/hil/bench/cpu_hog.hpp"
#include "sim/hil/bench/program_under_test.hpp"
#include "sim/hil/bench/recording_disk.hpp"
#include "sim/hil/bench/stepped_clock.hpp"
#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/vehicle_clock.hpp"

namespace fathom::sim {

// The script's faults of the computer itself and of the program's processes: disk_full, cpu_hog, clock_step,
// those of mapper and vehicle. Each is ended when its time is over, and at the latest when run() returns.
class MachineFaults {
 public:
  // `disk`, `stepped`, `program`: may be null; then their faults are not done, and said so.
  MachineFaults(const MissionSchedule& schedule, const FaultScript& script, VehicleClock& clock,
                RecordingDisk* disk, SteppedClock* stepped, ProgramUnderTest* program);

  void run(const std::atomic<bool>& stop);
  // By kind, after run(): times done, clock steps with those back.
  [[nodiscard]] const std::array<std::uint64_t, kFaultKinds>& done() const { return done_; }
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  void begin(const Fault& fault);
  void end(const Fault& fault);

  const MissionSchedule& schedule_;
  FaultScript script_;
  VehicleClock& clock_;
  RecordingDisk* disk_;
  SteppedClock* stepped_;
  ProgramUnderTest* program_;
  CpuHog hog_;
  std::array<std::uint64_t, kFaultKinds> done_{};
  std::vector<std::string> notes_;
};

}  // namespace fathom::sim
