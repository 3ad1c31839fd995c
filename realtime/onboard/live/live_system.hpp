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
#include "realtime/kernel/heap_counter.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/kernel/periodic_loop.hpp"
#include "realtime/kernel/tiers/arming.hpp"
#include "realtime/kernel/tiers/realtime_config.hpp"
#include "realtime/kernel/vehicle_clock.hpp"
#include "realtime/onboard/checkpoint/checkpoint_writer.hpp"
#include "realtime/onboard/live/device_threads.hpp"
#include "realtime/onboard/live/hard_tier.hpp"
#include "realtime/onboard/live/live_report.hpp"
#include "realtime/onboard/live/resume.hpp"
#include "realtime/onboard/live/soft_tier.hpp"
#include "realtime/onboard/live/supervisor.hpp"
#include "realtime/onboard/live/watched_threads.hpp"
#include "realtime/onboard/recorded_pairs.hpp"
#include "realtime/onboard/slots/slot_file.hpp"

namespace fathom::onboard {

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
};

// The tiers wired together: devices, hard tier, soft tier, recorder, modem, each on its thread, from the
// pools to the end of the survey. What it does to a mission is in the sequence of inputs alone; this class
// only moves it. Supervisor looks after it, live_report tells of it.
class LiveSystem {
 public:
  // Everything that lives as long as the program is made here. Throws InputError, std::system_error.
  LiveSystem(LiveSetup setup, LiveDevices devices, rt::VehicleClock& clock);
  ~LiveSystem();
  LiveSystem(const LiveSystem&) = delete;
  LiveSystem& operator=(const LiveSystem&) = delete;

  [[nodiscard]] const rt::MemoryBudget& budget() const { return budget_; }
  // Starts every thread, locks memory, and lets the hard tier go if that was granted, or soft mode overrides.
  [[nodiscard]] rt::ArmingResult arm();
  [[nodiscard]] const rt::HeapReserve& heap() const { return heap_; }

  // Some times a second; a line for each thing that happened.
  [[nodiscard]] std::vector<std::string> supervise();

  // The survey ends: devices stop, what waits is worked off, poses and map become final.
  void stop();
  // onboard/ of the mission folder, with live.json. After stop().
  // False when no pair gave a map: then there is no onboard/.
  [[nodiscard]] bool write();

  // What was measured when it was armed, and when the survey ended.
  struct Measured {
    std::size_t resident_at_arming = 0, heap_used = 0, heap_overflow = 0;  // [bytes]
    std::vector<ThreadFigures> cpu;
  };
  [[nodiscard]] const Measured& measured() const { return measured_; }
  // After stop().
  [[nodiscard]] const rt::PeriodicLoop::Statistics& hardLoop() const { return loop_->statistics(); }
  // Of the hard tier since it was armed.
  [[nodiscard]] rt::ThreadCost hardCost() const;
  [[nodiscard]] std::vector<io::DeviceHealth> deviceHealth() const;
  [[nodiscard]] io::Recorder& recorder() { return recorder_; }
  [[nodiscard]] const io::Recorder& recorder() const { return recorder_; }
  [[nodiscard]] HardTier& hard() { return hard_; }
  [[nodiscard]] const HardTier& hard() const { return hard_; }
  [[nodiscard]] SoftTier& soft() { return *soft_; }
  [[nodiscard]] const SoftTier& soft() const { return *soft_; }
  [[nodiscard]] const HeldFrames& frames() const { return frames_; }
  [[nodiscard]] const CheckpointWriter& checkpoints() const { return *checkpoints_; }
  [[nodiscard]] MissionRun& run() { return *run_; }
  [[nodiscard]] rt::StageTimes& hardStages() { return hard_stages_; }
  [[nodiscard]] rt::StageTimes& softStages() { return soft_stages_; }
  [[nodiscard]] rt::StageTimes& recorderStages() { return recorder_stages_; }
  [[nodiscard]] const rt::StageTimes& hardStages() const { return hard_stages_; }
  [[nodiscard]] const rt::StageTimes& softStages() const { return soft_stages_; }
  [[nodiscard]] const rt::StageTimes& recorderStages() const { return recorder_stages_; }
  [[nodiscard]] const ModemThread* modem() const { return modem_.get(); }
  [[nodiscard]] const OnboardConfig& config() const { return setup_.config; }
  // Another best-effort thread that runs until the devices stop, watched like the others. Before arm(); its
  // lane of the recorder.
  std::size_t addBestEffort(const char* name, std::function<void()> step, std::int64_t rest_ns);
  [[nodiscard]] const rt::Watchdog& watchdog() const { return threads_.watchdog(); }
  [[nodiscard]] const rt::ArmingResult& arming() const { return arming_; }  // by the thread that armed it
  // Armed with all that real time needs; from any thread.
  [[nodiscard]] bool complete() const { return complete_.load(std::memory_order_relaxed); }
  // Of the hard loop, which keeps its phase; monotonic, 0 before it is let go. From any thread.
  [[nodiscard]] std::int64_t firstDeadlineNs() const {
    return first_deadline_ns_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::uint64_t clockSteps() const { return supervisor_->clockSteps(); }
  // The program went on with an earlier run's dive; how long nobody listened [s],
  // known when armed; what was passed over.
  [[nodiscard]] bool resumed() const { return resumed_; }
  [[nodiscard]] double awaySeconds() const { return static_cast<double>(away_ns_) * 1e-9; }
  [[nodiscard]] const std::vector<std::string>& resumeSaid() const { return resume_said_; }
  // The checkpoint that it began with; 0: none, the log from its beginning.
  [[nodiscard]] std::uint64_t resumedFrom() const { return resumed_from_; }

 private:
  struct Sample {
    InputRing ring;
    std::unique_ptr<SampleThread> thread;
  };
  struct Slots {
    std::unique_ptr<SlotFile> features, meshes;
  };

  static Slots makeSlots(const LiveSetup& setup, bool reopen);
  static std::unique_ptr<OnboardOutput> makeOutput(const LiveSetup& setup, bool reopen);
  [[nodiscard]] std::unique_ptr<MissionRun> makeRun();
  // Brings the run and the hard tier to where the program was.
  void resume();
  void writeCheckpoint();
  [[nodiscard]] std::vector<std::filesystem::path> checkpointNeeds() const;
  void beginFromTheLog(const std::string& why);
  [[nodiscard]] std::optional<ImageView> pixels(const std::string& file_name, CameraSide side);
  [[nodiscard]] bool hasPixels(const std::string& file_name, CameraSide side);
  void planThreads();
  void planMemory();
  void runHard(rt::Heartbeat& heart);
  void runSoft(rt::Heartbeat& heart);
  void runRecorder(rt::Heartbeat& heart);

  LiveSetup setup_;
  LiveDevices devices_;
  rt::VehicleClock& clock_;
  rt::MemoryBudget budget_;
  rt::ArmingResult arming_;
  rt::TimelineTrack hard_track_, soft_track_, recorder_track_;
  rt::StageTimes hard_stages_, soft_stages_, recorder_stages_;
  io::Recorder recorder_;
  SequenceRing sequence_;
  ModemRing modem_ring_;
  RingFramePort modem_port_;
  std::array<InputRing, 3> own_rings_;  // left camera, right camera, modem
  std::array<FrameRing, 2> frame_rings_;
  std::deque<Sample> samples_;
  std::unique_ptr<CameraThread> left_, right_;
  std::unique_ptr<ModemThread> modem_;
  CheckpointFiles checkpoint_files_;
  CheckpointNames names_;
  Resume resume_;
  std::uint64_t next_checkpoint_ = 1;
  std::optional<std::uint64_t> syncs_then_;  // of the recorder, when the checkpoint that waits was first seen
  bool resumed_ = false;
  std::uint64_t resumed_from_ = 0;
  std::int64_t away_since_ns_ = 0, away_ns_ = 0;
  std::unique_ptr<OnboardOutput> output_;
  Slots slots_;
  RecordedPairs recorded_;  // pixels of before the program started again
  OnboardSystem::PairSource recorded_source_;
  std::unique_ptr<CheckpointWriter> checkpoints_;
  HeldFrames frames_;
  std::unique_ptr<MissionRun> run_;
  HardTier hard_;
  std::unique_ptr<SoftTier> soft_;
  std::optional<rt::PeriodicLoop> loop_;  // from the moment that it is let go
  WatchedThreads threads_;
  std::optional<Supervisor> supervisor_;
  std::atomic<bool> go_{false}, stop_devices_{false}, stop_hard_{false}, stop_soft_{false},
      stop_modem_{false}, stop_recorder_{false}, soft_done_{false}, complete_{false};
  std::atomic<std::uint64_t> hard_heap_calls_{0}, hard_minor_faults_{0}, hard_major_faults_{0},
      hard_slipped_{0};
  std::atomic<std::int64_t> first_deadline_ns_{0};
  std::size_t lanes_ = 0;  // of the recorder, in use
  bool stopped_ = false;
  rt::HeapReserve heap_;
  std::int64_t begun_mono_ns_ = 0;
  std::vector<std::string> resume_said_;
  Measured measured_;
};

}  // namespace fathom::onboard
