#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "firmware_if/recorder/recorder.hpp"
#include "realtime/kernel/clock.hpp"
#include "realtime/kernel/health/stage_times.hpp"
#include "realtime/kernel/latest_value.hpp"
#include "realtime/kernel/tiers/overload_rule.hpp"
#include "realtime/onboard/checkpoint/checkpoint_writer.hpp"
#include "realtime/onboard/live/device_threads.hpp"
#include "realtime/onboard/live/held_frames.hpp"
#include "realtime/onboard/live/input_rings.hpp"
#include "realtime/onboard/live/resume.hpp"
#include "realtime/onboard/mission_run.hpp"

namespace fathom::onboard {

// What the soft tier shows of itself to whoever publishes.
struct MapState {
  std::int64_t utc_ns = 0;  // of the newest input consumed
  SE3 T_nav_odom;
  bool anchored = false;
  telemetry::Status status;
  double mapped_area = 0;  // [m2]
  std::uint64_t pairs = 0, pairs_shed = 0, keyframes = 0, closures = 0, map_meshes_moved = 0;
  int map_tiles = 0, map_tiles_high_water = 0, map_layers = 0, map_layers_high_water = 0;
  std::uint64_t map_coarsened = 0, map_refused = 0;
  std::uint64_t link_frames = 0, link_bytes = 0, link_blocks_waiting = 0, link_frames_arrived = 0;
  rt::DegradationLevel level = rt::DegradationLevel::kFull;
  std::int64_t lag_ns = 0, highest_lag_ns = 0;  // behind the hard tier
  std::uint64_t frames_given_back = 0;          // that found no partner, or no time
  MapState() noexcept = default;
  MapState(const MapState&) noexcept = default;
  MapState& operator=(const MapState&) noexcept = default;
};

// The soft tier's work: takes the sequence in order through the mission run, decides by its own lag and the
// time that pairs take how much a pair may cost, and logs what it decided.
class SoftTier {
 public:
  struct Links {
    SequenceRing* sequence = nullptr;
    HeldFrames* frames = nullptr;
    io::Recorder* recorder = nullptr;  // may be null
    RingFramePort* modem = nullptr;
    CheckpointWriter* checkpoints = nullptr;
    CheckpointNames names;
    // Whether the pixels of an exposure can be had, by its file's name.
    std::function<bool(const std::string& file_name, CameraSide side)> has_pixels;
  };
  static constexpr std::size_t kStages = 16;
  static const std::array<rt::StageSpec, kStages>& stageSpecs();

  SoftTier(MissionRun& run, const Links& links, const rt::OverloadConfig& overload,
           std::int64_t pair_period_ns, rt::Clock& clock, rt::StageTimes& stages);

  // What was logged behind the checkpoint that the run was loaded from: consumed first, without sending
  // anything.
  void catchUpWith(Resume resume);
  [[nodiscard]] bool caughtUp() const noexcept { return caught_up_.load(std::memory_order_acquire); }

  // Consumes at most `most` inputs that wait; how many it was.
  std::size_t work(std::size_t most);
  void consume(const io::OnboardInput& input);
  // The sequence has been consumed to its end mark.
  [[nodiscard]] bool ended() const { return run_.ended(); }
  [[nodiscard]] const rt::OverloadRule& overload() const { return rule_; }

  // By one reader each.
  [[nodiscard]] bool readForBus(MapState& state) noexcept { return for_bus_.readNew(state); }
  [[nodiscard]] bool readForSupervisor(MapState& state) noexcept { return for_supervisor_.read(state); }

 private:
  [[nodiscard]] OnboardSystem::PairQuota decide(const StereoTrigger& trigger,
                                                const OnboardSystem::MappedPair& pair);
  void noteStage(const char* stage);
  void noteMapped(const OnboardSystem::MappedPair& pair);
  void publish(std::int64_t now_ns);
  std::size_t catchUp(std::size_t most);
  void saveState(std::uint64_t number);

  MissionRun& run_;
  Resume resume_;
  std::size_t next_of_tail_ = 0;
  std::atomic<bool> caught_up_{true};
  Links links_;
  rt::OverloadRule rule_;
  std::int64_t period_ns_;
  rt::Clock& clock_;
  rt::StageTimes& stages_;
  rt::LatestValue<MapState> for_bus_, for_supervisor_;
  std::int64_t pair_begin_ns_ = 0, stage_begin_ns_ = 0;  // monotonic
  std::int64_t last_frame_ns_ = 0;                       // that the last mapped pair took
  std::int64_t lag_ns_ = 0, highest_lag_ns_ = 0;
  std::int64_t published_ns_ = 0;
};

}  // namespace fathom::onboard
