#include "sim/hil/bench/machine_faults.hpp"

#include <algorithm>
#include <csignal>

namespace fathom::sim {
namespace {

// Faults injected by this class.
bool isMachineFault(FaultKind kind) {
  return kind >= FaultKind::kDiskFull;
}

bool stops(FaultKind kind) {
  return kind == FaultKind::kMapperStopped || kind == FaultKind::kVehicleStopped;
}

ProgramUnderTest::Process processOf(FaultKind kind) {
  const bool mapper = kind == FaultKind::kMapperKilled || kind == FaultKind::kMapperStopped;
  return mapper ? ProgramUnderTest::Process::kMapper : ProgramUnderTest::Process::kVehicle;
}

}  // namespace

MachineFaults::MachineFaults(const MissionSchedule& schedule, const FaultScript& script,
                             SimulatedVehicleClock& clock, RecordingDisk* disk, SteppedClock* stepped,
                             ProgramUnderTest* program)
    : schedule_(schedule),
      script_(script),
      clock_(clock),
      disk_(disk),
      stepped_(stepped),
      program_(program) {}

void MachineFaults::begin(const Fault& fault) {
  std::uint64_t& count = done_[static_cast<std::size_t>(fault.kind)];
  switch (fault.kind) {
    case FaultKind::kDiskFull:
      if (disk_ == nullptr) {
        notes_.emplace_back("disk_full was not done: the recording has no disk of its own");
      } else if (disk_->fill(fault.leave_mib)) {
        ++count;
      } else {
        notes_.emplace_back("disk_full was not done: the disk could not be filled");
      }
      break;
    case FaultKind::kCpuHog:
      hog_.start(fault.threads);
      ++count;
      break;
    case FaultKind::kClockStep:
      if (stepped_ == nullptr) {
        notes_.emplace_back("clock_step was not done: the bench has not started the program");
      } else {
        stepped_->step(fault.step_s);
        ++count;
      }
      break;
    case FaultKind::kMapperKilled:
    case FaultKind::kVehicleKilled:
    case FaultKind::kMapperStopped:
    case FaultKind::kVehicleStopped:
      if (program_ != nullptr &&
          program_->signalProcess(processOf(fault.kind), stops(fault.kind) ? SIGSTOP : SIGKILL))
        ++count;
      else
        notes_.push_back(std::string(nameOf(fault.kind)) + " was not done: the bench has no such process");
      break;
    default:
      break;
  }
}

void MachineFaults::end(const Fault& fault) {
  switch (fault.kind) {
    case FaultKind::kDiskFull:
      if (disk_ != nullptr) disk_->makeRoom();
      break;
    case FaultKind::kCpuHog:
      hog_.stop();
      break;
    case FaultKind::kClockStep:
      if (stepped_ != nullptr && fault.for_s > 0) {
        stepped_->step(-fault.step_s);
        ++done_[static_cast<std::size_t>(fault.kind)];
      }
      break;
    // The process may have been killed before.
    case FaultKind::kMapperStopped:
    case FaultKind::kVehicleStopped:
      if (program_ != nullptr) (void)program_->signalProcess(processOf(fault.kind), SIGCONT);
      break;
    default:
      break;
  }
}

void MachineFaults::run(const std::atomic<bool>& stop) {
  struct Event {
    double mission_s = 0;
    const Fault* fault = nullptr;
    bool begins = true;
  };
  std::vector<Event> events;
  for (const Fault& f : script_.faults) {
    if (!isMachineFault(f.kind)) continue;
    if (schedule_.vehicleTime(f.at_s) > schedule_.end_utc_ns) continue;
    events.push_back({f.at_s, &f, true});
    events.push_back({f.at_s + f.for_s, &f, false});
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.mission_s < b.mission_s; });
  std::vector<const Fault*> open;
  for (const Event& m : events) {
    if (!clock_.sleepUntil(schedule_.vehicleTime(m.mission_s), stop)) break;
    if (m.begins) {
      open.push_back(m.fault);
      begin(*m.fault);
    } else {
      std::erase(open, m.fault);
      end(*m.fault);
    }
  }
  for (const Fault* fault : open) end(*fault);
}

}  // namespace fathom::sim
