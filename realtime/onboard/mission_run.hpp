#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/onboard/modem/frame_exchange.hpp"
#include "realtime/onboard/onboard_output.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "realtime/onboard/stage_clock.hpp"

namespace fathom::onboard {

// Results of a run, for the operator.
struct RunSummary {
  std::uint64_t samples = 0, pairs = 0, pairs_used = 0, unreadable_images = 0;
  std::uint64_t frames = 0, frame_bytes = 0;  // sent
  std::uint64_t frames_received = 0;
  double mapped_area = 0;       // [m2]
  double mission_s = 0;         // from first to last input
  double stereo_and_map_s = 0;  // wall clock in the cores, images read apart
  std::string warning;          // for the operator; empty: none
};

// The soft tier's work, live and in replay alike: feeds the inputs to the system in order, and its results to
// onboard/ and the modem. What it writes depends on the inputs alone, except timing.json.
class MissionRun {
 public:
  struct Setup {
    OnboardConfig config;
    io::MissionConfig mission;
    StereoRig rig;
    OnboardSystem::PairSource pairs;
    MapSlots slots;
    FrameExchangeOptions link;
    std::function<double()> reading_s;  // spent reading images so far; empty: nothing
  };
  MissionRun(Setup setup, OnboardOutput& output);
  MissionRun(const MissionRun&) = delete;
  MissionRun& operator=(const MissionRun&) = delete;

  // Decisions are for the caller (setPairPolicy) and are ignored here. At the mark of a checkpoint the slots
  // begin to keep their content.
  void consume(const io::OnboardInput& input);
  // No more inputs: makes the final poses and map; then the link continues to send, for `drain_s` [s] at
  // most.
  void finish(double drain_s);
  // Writes all results into the output, which the caller commits. False when no pair gave a map.
  [[nodiscard]] bool write(std::uint64_t damaged_entries, double wall_s);

  // Saved state, including the output's. load() needs a new run of the same mission and configuration, which
  // is unusable if it fails. readyToSave(): false while the output is not completely on the disk
  // (OnboardOutput).
  [[nodiscard]] bool readyToSave() { return output_.readyToSave(); }
  void save(rt::StateWriter& writer);
  // Before load(): restores the slots to that checkpoint's mark; see SlotStore.
  [[nodiscard]] bool rollBackSlots(std::uint64_t checkpoint);
  void forgetSlots(std::uint64_t before_checkpoint);
  [[nodiscard]] bool load(rt::StateReader& reader);
  // After load(): false if a power loss left slots of another time than the state.
  [[nodiscard]] bool slotsHold();
  // Consumed so far, marks too.
  [[nodiscard]] std::uint64_t inputs() const { return inputs_; }

  [[nodiscard]] RunSummary summary() const;
  [[nodiscard]] OnboardSystem& system() { return system_; }
  [[nodiscard]] const OnboardSystem& system() const { return system_; }
  // Called when a stage of a pair's work ends, with its name, for every pair seen, and for every pair placed.
  void setObservers(std::function<void(const char* stage)> on_stage, OnboardSystem::OnPair on_seen,
                    OnboardSystem::OnPair on_pair);
  // The end mark was consumed.
  [[nodiscard]] bool ended() const { return ended_; }
  [[nodiscard]] std::int64_t nowNs() const { return now_ns_; }

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  template <typename Work>
  void eachSlotStore(const Work& work) {
    for (SlotStore* slots : {setup_.slots.features, setup_.slots.meshes})
      if (slots != nullptr) work(*slots);
  }
  void begin(std::int64_t now_ns);
  void consumeSample(std::int64_t now_ns, const SensorSample& sample);
  void notePlaced(const OnboardSystem::MappedPair& pair);
  void consumeMark(const io::Mark& mark);
  void writeRows(std::int64_t now_ns);
  [[nodiscard]] double reading() const { return setup_.reading_s ? setup_.reading_s() : 0.0; }

  Setup setup_;
  OnboardOutput& output_;
  OnboardSystem system_;
  StageClock stages_;
  std::function<void(const char* stage)> on_stage_;
  OnboardSystem::OnPair on_pair_;
  FrameExchange link_;
  RunSummary summary_;
  bool begun_ = false, ended_ = false;
  bool link_silent_ = false;  // from the mark of a lost mapper to that of its restart
  std::uint64_t inputs_ = 0;
  std::int64_t first_ns_ = 0, now_ns_ = 0;
  std::int64_t next_odometry_ns_ = 0, next_health_ns_ = 0, last_odometry_ns_ = 0;
  double finish_s_ = 0;
};

// What a level of degradation leaves of a pair's work. Each level takes away what the one before it does, and
// more:
//   1  half of the stereo points;  2  no loop closures now;  3  a quarter of the points (so coarser cells)
//   and of the meshes fused again;  4  the pair is dropped.
[[nodiscard]] inline OnboardSystem::PairQuota pairQuota(const io::Decision& decision) {
  OnboardSystem::PairQuota quota;
  quota.level = decision.level;
  quota.drop = decision.dropped;
  if (decision.level >= 1) quota.feature_share = 0.5;
  if (decision.level >= 2) quota.closures = false;
  if (decision.level >= 3) quota.feature_share = quota.rebuild_share = 0.25;
  return quota;
}

}  // namespace fathom::onboard
