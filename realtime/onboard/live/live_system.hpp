#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/recorder/recorder.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "realtime/kernel/health/stage_times.hpp"
#include "realtime/kernel/memory/heap_counter.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/threads/arming.hpp"
#include "realtime/kernel/threads/realtime_config.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"
#include "realtime/onboard/live/devices/device_threads.hpp"
#include "realtime/onboard/live/hard_tier.hpp"
#include "realtime/onboard/live/resume.hpp"
#include "realtime/onboard/live/supervisor.hpp"
#include "realtime/onboard/live/watched_threads.hpp"
#include "realtime/onboard/mapper/mapper_keeper.hpp"

namespace fathom::onboard {

class LiveSystem;

struct ThreadFigures {
  std::string name;
  double cpu_s = 0;
};
// Of every thread of this process, the busiest first.
[[nodiscard]] std::vector<ThreadFigures> cpuTimes();
// When what was reached, since the program's start; 0: not yet [s]. The first pair of a dive that is
// continued is none of these.
struct StartTimes {
  double armed = 0, navigating = 0, first_pair = 0;
};
// live.json, when the survey has ended.
[[nodiscard]] std::string liveJson(const LiveSystem& live_system, double wall_s, const StartTimes& start);
// The last `seconds` of all tiers, in Chrome's trace format; while they run.
[[nodiscard]] std::string timelineOf(const LiveSystem& live, std::int64_t now_ns, double seconds);

// What the vehicle has; any may be absent but the cameras.
struct LiveDevices {
  std::vector<std::unique_ptr<io::SampleSource>> samples;
  std::unique_ptr<io::CameraSource> left, right;
  std::unique_ptr<FramePort> modem;
};

struct LiveSetup {
  std::filesystem::path folder;  // of the mission: mission.toml, stereo.calib; the recording goes there
  OnboardConfig config;
  io::MissionConfig mission;
  StereoRig rig;
  // What the mapper process is: this program, with the configuration that `config` was read from.
  std::filesystem::path mapper_program = "/proc/self/exe";
  std::optional<std::filesystem::path> config_file;
  // Ends the process, because of `why`, for its keeper to start it again. Empty: it has no keeper and
  // continues.
  std::function<void(const std::string& why)> lost = {};
};

// The vehicle process: devices, hard tier, recorder and modem, each on its thread, and the mapper process,
// which is started, watched and restarted. The sequence of inputs alone determines the mission's results;
// this class only transports it. Supervisor supervises it, live_report reports on it.
class LiveSystem {
 public:
  // Everything that lives as long as the program is made here. Throws InputError, std::system_error.
  LiveSystem(LiveSetup setup, LiveDevices devices, rt::VehicleClock& clock);
  ~LiveSystem();
  LiveSystem(const LiveSystem&) = delete;
  LiveSystem& operator=(const LiveSystem&) = delete;

  [[nodiscard]] const rt::MemoryBudget& budget() const { return budget_; }
  // Starts the mapper and every thread, locks memory, and starts the hard tier if that was granted or soft
  // mode overrides. A new dive waits here for the mapper's memory plan, to check the budget as a whole; a
  // continued one does not.
  [[nodiscard]] rt::ArmingResult arm();
  [[nodiscard]] const rt::HeapReserve& heap() const { return heap_; }
  // --print-budget, instead of arm(): prints the pools of this process, then those of the mapper, which it
  // prints itself, and the sum. Returns an exit status.
  [[nodiscard]] int printBudget();

  // Call some times a second until end() or leave(); returns a line per event. If it is not called,
  // navigation stands still, or a thread hangs for good, the program is lost (LiveSetup).
  [[nodiscard]] std::vector<std::string> supervise();

  // How a run ended, for the operator.
  struct End {
    bool mapped = false;                // onboard/ is whole
    bool no_map = false;                // the mapper ended, but no pair gave a map
    std::vector<std::string> left_out;  // what could not be done in time, or at all
  };
  // Ends the survey: devices stop, queues are completed, poses and map become final. Returns within `most_s`
  // even if parts hang; what is not done by then is left out and reported.
  [[nodiscard]] End end(double most_s);
  // The program ends, the dive does not: it continues when the program is started again.
  [[nodiscard]] End leave(double most_s);
  // After either: some threads could not be ended; the process must end without waiting for them
  // (std::_Exit).
  [[nodiscard]] bool hangs() const { return hangs_; }

  // Measured at arming and at the end of the survey.
  struct Measured {
    std::size_t resident_at_arming = 0, heap_used = 0, heap_overflow = 0;  // [bytes]
    std::vector<ThreadFigures> cpu;
  };
  [[nodiscard]] const Measured& measured() const { return measured_; }
  // After end() or leave(); null when it was never let go.
  [[nodiscard]] const rt::PeriodicLoop::Statistics* hardLoop() const {
    return loop_ ? &loop_->statistics() : nullptr;
  }
  // Of the hard tier since it was armed.
  [[nodiscard]] rt::ThreadCost hardCost() const;
  [[nodiscard]] std::vector<io::DeviceHealth> deviceHealth() const;
  [[nodiscard]] io::Recorder& recorder() { return recorder_; }
  [[nodiscard]] const io::Recorder& recorder() const { return recorder_; }
  [[nodiscard]] HardTier& hard() { return hard_; }
  [[nodiscard]] const HardTier& hard() const { return hard_; }
  [[nodiscard]] const MapperChannel& mapper() const { return channel_; }
  [[nodiscard]] const Supervisor& supervisor() const { return *supervisor_; }
  [[nodiscard]] OwnStatus& ownStatus() { return own_status_; }
  [[nodiscard]] const PartStates& parts() const { return parts_; }
  [[nodiscard]] pid_t mapperPid() const { return child_->pid(); }
  [[nodiscard]] rt::StageTimes& hardStages() { return hard_stages_; }
  [[nodiscard]] rt::StageTimes& recorderStages() { return recorder_stages_; }
  [[nodiscard]] const rt::StageTimes& hardStages() const { return hard_stages_; }
  [[nodiscard]] const rt::StageTimes& recorderStages() const { return recorder_stages_; }
  [[nodiscard]] const ModemThread* modem() const { return modem_.get(); }
  [[nodiscard]] const OnboardConfig& config() const { return setup_.config; }
  // Camera frames that were not lent because the mapper had no room.
  [[nodiscard]] std::uint64_t framesNotLent() const;
  // Adds a watched best-effort thread that runs until the devices stop. Before arm(). Returns its lane of the
  // recorder.
  std::size_t addBestEffort(const char* name, std::function<void()> step,
                            std::function<std::int64_t()> rest_ns);
  [[nodiscard]] const rt::Watchdog& watchdog() const { return threads_.watchdog(); }
  // Grows while navigation runs; from any thread.
  [[nodiscard]] std::uint64_t navigationBeats() const { return navigation_->beats(); }
  [[nodiscard]] const rt::ArmingResult& arming() const { return arming_; }  // by the thread that armed it
  // Armed with all that real time needs; from any thread.
  [[nodiscard]] bool complete() const { return complete_.load(std::memory_order_relaxed); }
  // First deadline of the hard loop, which keeps its phase; monotonic, 0 before it starts. From any thread.
  [[nodiscard]] std::int64_t firstDeadlineNs() const {
    return first_deadline_ns_.load(std::memory_order_relaxed);
  }
  // Whether this run continues an earlier run's dive; the interruption [s], known when armed; what was passed
  // over.
  [[nodiscard]] bool resumed() const { return resume_.any(); }
  [[nodiscard]] double awaySeconds() const { return static_cast<double>(away_ns_) * 1e-9; }
  [[nodiscard]] const std::vector<std::string>& resumeSaid() const { return resume_.said; }

 private:
  struct Sample {
    InputRing ring;
    std::unique_ptr<SampleThread> thread;
  };

  void shareWithMapper();
  [[nodiscard]] MapperChild::Start childStart(bool plan) const;
  void planThreads();
  void planMemory();
  void addMapperToBudget();
  void navigate(rt::Heartbeat& heart);
  void runHard(rt::Heartbeat& heart);
  void runRecorder(rt::Heartbeat& heart);
  void runWatchdog(rt::Heartbeat& heart);
  void endIfHanging();
  void takeFromMapper();
  [[nodiscard]] bool waitFor(const std::function<bool()>& done, std::int64_t until_ns);
  void finishThreads(End& end, std::int64_t until_ns, bool dive_ends);

  LiveSetup setup_;
  LiveDevices devices_;
  rt::VehicleClock& clock_;
  rt::MemoryBudget budget_;
  rt::ArmingResult arming_;
  rt::TimelineTrack hard_track_, recorder_track_;
  rt::StageTimes hard_stages_, recorder_stages_;
  CheckpointNames names_;
  MapperChannel channel_;
  io::Recorder recorder_;
  std::array<InputRing, 3> own_rings_;  // left camera, right camera, modem
  std::optional<FrameLender> left_frames_, right_frames_;
  std::deque<Sample> samples_;
  std::unique_ptr<CameraThread> left_, right_;
  std::unique_ptr<ModemThread> modem_;
  OwnStatus own_status_;
  HardTier hard_;
  VehicleResume resume_;
  std::int64_t away_ns_ = 0;
  std::optional<rt::PeriodicLoop> loop_;  // from the moment that it is let go
  WatchedThreads threads_;
  const rt::Heartbeat* navigation_ = nullptr;
  PartStates parts_;
  std::unique_ptr<MapperChild> child_;
  std::optional<Supervisor> supervisor_;
  HungRestarts hung_restarts_;
  std::vector<std::string> early_events_;  // from before arming, not reported yet
  std::atomic<bool> go_{false}, ends_{false}, stop_devices_{false}, stop_hard_{false}, stop_modem_{false},
      stop_recorder_{false}, complete_{false};
  std::atomic<std::uint64_t> hard_heap_calls_{0}, hard_minor_faults_{0}, hard_major_faults_{0},
      hard_skipped_{0};
  std::atomic<std::int64_t> first_deadline_ns_{0};
  std::atomic<std::uint64_t> supervised_{0};  // times
  std::size_t lanes_ = 0;                     // of the recorder, in use
  bool stopped_ = false, hangs_ = false;
  rt::HeapReserve heap_;
  std::int64_t begun_mono_ns_ = 0;
  Measured measured_;
};

}  // namespace fathom::onboard
