#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "sim/hil/bench/program_under_test.hpp"
#include "sim/hil/fault_script.hpp"
#include "sim/hil/mission_schedule.hpp"
#include "sim/hil/players/simulated_vehicle_clock.hpp"

namespace fathom::sim {

// A separate disk for the recording, which can be filled without side effects: an ext4 file system in a file,
// mounted at the recording's folder and visible to this process and its children only. close() copies the
// recording to the folder below the mount.
class RecordingDisk {
 public:
  RecordingDisk() = default;
  ~RecordingDisk();
  RecordingDisk(const RecordingDisk&) = delete;
  RecordingDisk& operator=(const RecordingDisk&) = delete;

  // Mounts a disk at the empty folder for `written` bytes and `taken_unwritten` more, which are reserved only
  // (the file is sparse). Empty, or the reason of a failure. To be called before any thread is started.
  [[nodiscard]] std::string open(const std::filesystem::path& folder, std::uint64_t written,
                                 std::uint64_t taken_unwritten);
  [[nodiscard]] bool isOpen() const { return open_; }
  // Fills the disk except for `leave_mib`; false on failure.
  bool fill(double leave_mib);
  void makeRoom();  // undoes fill()
  // Copies what is on the disk to the folder underneath and unmounts. Throws std::runtime_error.
  void close();

 private:
  [[nodiscard]] std::filesystem::path filler() const { return folder_ / ".bench-filler"; }
  std::filesystem::path folder_, image_;
  bool open_ = false;
};

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
