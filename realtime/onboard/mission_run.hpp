#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/numbers/log_histogram.hpp"
#include "realtime/kernel/frame_port.hpp"
#include "realtime/onboard/onboard_output.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::onboard {

struct FrameExchangeOptions {
  FramePort* modem = nullptr;
  // Gives a simulated modem the mission's time before each use; a real one needs none.
  std::function<void(std::int64_t now_ns)> modem_clock;
  // A downlink.bin: frames to receive instead of the modem's, at the times at which they were received.
  std::optional<std::filesystem::path> downlink;
  double speed = 0;  // mission seconds a second, with a modem; 0: as fast as the machine goes
};

// Exchanges frames between the onboard system and the modem in mission time. Frames sent are written into
// packets.bin, frames received into downlink.bin, link frame by link frame, in the order in which the system
// consumed them. Frames are received once at each time, after its first sample: the same frames at the same
// times replay exactly.
class FrameExchange {
 public:
  // Throws InputError for a downlink file that cannot be read, is damaged or runs backwards.
  FrameExchange(OnboardOutput& output, const FrameExchangeOptions& options);

  // A link frame that the modem received earlier and that is part of the other inputs.
  void receive(OnboardSystem& system, std::int64_t now_ns, std::span<const std::uint8_t> frame);
  // Mission time is `now_ns`: waits for that moment if the speed is given, then receives and sends.
  void exchange(OnboardSystem& system, std::int64_t now_ns, bool survey_over);

  struct Counters {
    std::uint64_t sent = 0, sent_bytes = 0;
    std::uint64_t refused = 0;  // by the modem
    std::uint64_t received = 0;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  void setCounters(const Counters& counters) { counters_ = counters; }  // of saved state

 private:
  using Clock = std::chrono::steady_clock;
  void pace(std::int64_t now_ns) const;
  void receiveAll(OnboardSystem& system, std::int64_t now_ns);

  OnboardOutput& output_;
  FrameExchangeOptions options_;
  std::int64_t first_ns_ = 0;  // mission time at start_
  Clock::time_point start_;
  std::optional<std::int64_t> received_at_ns_;
  std::vector<telemetry::Packet> recorded_;  // of options_.downlink
  std::size_t next_recorded_ = 0;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer_{};
  Counters counters_;
};

// Wall-clock times of the stages that a core reports, and of whole frames.
class StageClock {
 public:
  void begin() {
    last_ = Clock::now();
    any_ = false;
  }
  // Since begin() or the stage before.
  void ended(const char* stage) {
    const auto now = Clock::now();
    stages_[stage].add(std::chrono::duration_cast<std::chrono::nanoseconds>(now - last_).count());
    last_ = now;
    any_ = true;
  }
  // A sample that led to stages was a frame.
  void endSample(double seconds) {
    if (any_) stages_["frame"].add(static_cast<std::int64_t>(seconds * 1e9));
  }
  [[nodiscard]] const std::map<std::string, rt::LogHistogram>& stages() const { return stages_; }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point last_;
  bool any_ = false;
  std::map<std::string, rt::LogHistogram> stages_;  // [ns]
};

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
