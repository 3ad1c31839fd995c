#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "realtime/kernel/health/stage_times.hpp"
#include "realtime/kernel/rings/broadcast_ring.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"
#include "realtime/onboard/nav/nav_core.hpp"

namespace fathom::onboard {

// From a device's thread to the hard tier. At 100 Hz of draining and at most some hundred samples a second,
// never more than a few wait; full only when the hard tier stands still for a second.
using InputRing = rt::SpscRing<io::OnboardInput, 256>;

// Merges the inputs of many devices into one sequence: the earliest arrival first among those that wait,
// never earlier than what was given out before. Part of the hard tier; allocates nothing.
class InputSequencer {
 public:
  static constexpr std::size_t kMaxRings = 12;

  // Before it runs. The ring must outlive the sequencer; more than kMaxRings is a broken contract.
  void add(InputRing& ring) noexcept;
  // No input is older than this: the last one before the program started again.
  void startAfter(std::int64_t utc_ns) noexcept { last_ns_ = utc_ns; }

  // The next input in order; false when nothing waits.
  [[nodiscard]] bool next(io::OnboardInput& input) noexcept;
  // An input of the sequencer's own thread, put behind what was given out.
  [[nodiscard]] io::OnboardInput own(std::int64_t now_ns, const io::OnboardInput::What& what) noexcept;

 private:
  struct Head {
    InputRing* ring = nullptr;
    bool filled = false;
    io::OnboardInput input;
  };
  std::array<Head, kMaxRings> heads_;
  std::size_t count_ = 0;
  std::int64_t last_ns_ = INT64_MIN;
};

// Navigation state of one cycle of the hard tier, for publication.
struct NavState {
  std::int64_t utc_ns = 0;       // of the cycle
  std::int64_t pose_utc_ns = 0;  // of the newest odometry; 0: none yet
  SE3 T_odom_body;
  Eigen::Vector3d velocity_body = Eigen::Vector3d::Zero();  // [m/s]
  std::optional<double> altitude;                           // [m]
  NavHealth health;                                         // of the newest tick
  std::uint64_t inputs = 0;                                 // put in order so far
  NavState() noexcept = default;
  NavState(const NavState&) noexcept = default;
  NavState& operator=(const NavState&) noexcept = default;
};

// The hard tier's work: orders the inputs, dead reckons, and passes the sequence to the recorder and, by
// position, to the mapper. cycle() is called once per period; no heap, no lock, bounded work.
class HardTier {
 public:
  struct Links {
    io::Recorder* recorder = nullptr;  // may be null: nothing is recorded
    InputBroadcast* inputs = nullptr;
  };
  static constexpr std::size_t kStages = 2;
  static constexpr std::array<rt::StageSpec, kStages> kStageSpecs = {
      {{"inputs and dead reckoning", 0}, {"publish", 0}}};

  HardTier(const NavCoreConfig& nav, const Links& links, rt::Clock& clock, rt::StageTimes& stages);

  [[nodiscard]] InputSequencer& sequencer() noexcept { return sequencer_; }
  [[nodiscard]] NavFeed& nav() noexcept { return nav_; }  // before it runs: a state is loaded
  // Applies an input to navigation alone; before it runs, for inputs that were consumed before the program
  // started again.
  void follow(const io::OnboardInput& input) noexcept;

  void cycle() noexcept;
  // Inserts a mark into the sequence in the next cycle: checkpoints, health, the end. From one other thread;
  // false when too many wait.
  [[nodiscard]] bool mark(const io::Mark& mark) noexcept { return marks_.push(mark); }

  // By one reader each.
  [[nodiscard]] bool readForBus(NavState& state) noexcept { return for_bus_.readNew(state); }
  [[nodiscard]] bool readForSupervisor(NavState& state) noexcept { return for_supervisor_.read(state); }
  // The end mark was passed to the recorder and the mapper. Only marks about a mapper that was restarted to
  // finish follow it.
  [[nodiscard]] bool ended() const noexcept { return ended_.load(std::memory_order_acquire); }

 private:
  static constexpr int kTickEvery = 10;          // cycles: 10 Hz at 100 Hz
  static constexpr int kMostInputsACycle = 256;  // the rest waits for the next cycle

  void give(const io::OnboardInput& input) noexcept;
  void giveMarks() noexcept;
  void publish(std::int64_t now_ns) noexcept;

  Links links_;
  rt::Clock& clock_;
  rt::StageTimes& stages_;
  InputSequencer sequencer_;
  NavFeed nav_;
  rt::SpscRing<io::Mark, 32> marks_;
  rt::LatestValue<NavState> for_bus_, for_supervisor_;
  int cycles_ = 0;
  std::uint64_t inputs_ = 0;
  std::int64_t last_health_ns_ = 0;
  std::atomic<bool> ended_{false};
};

}  // namespace fathom::onboard
