#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "realtime/kernel/health/stage_times.hpp"
#include "realtime/kernel/threads/overload_rule.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "realtime/onboard/mapper/input_feed.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"
#include "realtime/onboard/mission_run.hpp"

namespace fathom::onboard {

// Modem port of the mapper: frames to send go into a ring; received frames come as inputs.
class RingFramePort final : public FramePort {
 public:
  explicit RingFramePort(ModemRing& ring) : ring_(ring) {}
  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t>) noexcept override { return 0; }
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return 0; }
  // Muted while frames would be sent that were already sent before the program started again.
  void setMuted(bool muted) noexcept { muted_ = muted; }

 private:
  bool muted_ = false;
  ModemRing& ring_;
};

// The mapper's work: feeds the inputs in the log's order to the mission run, decides from its lag and the
// time per pair how much work a pair may cost, and has its decisions logged. It works identically on new and
// on logged inputs; only, up to the mark of its own start, earlier decisions are repeated, no measured time
// decides, and nothing is sent.
class MapperTier {
 public:
  struct Links {
    InputFeed* feed = nullptr;
    HeldFrames* frames = nullptr;
    MapperChannel* channel = nullptr;
    RingFramePort* modem = nullptr;
    CheckpointWriter* checkpoints = nullptr;
    std::uint64_t configuration = 0, mission = 0;  // of a checkpoint's head
    // Whether the pixels of an exposure can be had, by its file's name.
    std::function<bool(const std::string& file_name, CameraSide side)> has_pixels;
    std::function<void(MapperFigures&)> memory;  // adds the process' figures of it
    std::function<bool()> output_lost;           // the disk refused what output or map lacks
  };
  struct Config {
    rt::OverloadConfig overload;
    std::int64_t pair_period_ns = 500'000'000;
    std::int64_t checkpoint_ns = 10'000'000'000;  // states are not saved more often than at half of it
  };
  static constexpr std::size_t kStages = MapperFigures::kStages;
  static const std::array<rt::StageSpec, kStages>& stageSpecs();
  // Summary of a stage from a mapper's figures, with its name.
  [[nodiscard]] static rt::StageSummary summaryOf(const MapperFigures& figures, std::size_t stage);

  MapperTier(MissionRun& run, const Links& links, const Config& config, rt::Clock& clock);

  // The run was loaded from checkpoint `number` (0: none): a mark kRestart with that number at position
  // `from` or later is this start's, and ends the silence.
  void awaitMark(std::uint64_t number, std::uint64_t from);

  // Consumes at most `most` waiting inputs; returns their number.
  std::size_t work(std::size_t most);
  // The log was consumed to its end mark, and to the mark of this start.
  [[nodiscard]] bool ended() const { return run_.ended() && !awaited_; }
  // Publishes the measured figures in the channel; some times a second at most.
  void publish();
  // A sign of life, for work that takes long.
  void beat() noexcept;

 private:
  [[nodiscard]] OnboardSystem::PairQuota decide(const StereoTrigger& trigger,
                                                const OnboardSystem::MappedPair& pair);
  [[nodiscard]] std::optional<io::Decision> decidedBefore(std::uint32_t pair) const;
  void consume(const io::OnboardInput& input, std::uint64_t position);
  void addStage(std::size_t stage, std::int64_t begin_ns, std::int64_t end_ns);
  void noteStage(const char* stage);
  void noteSeen(const OnboardSystem::MappedPair& pair);
  void notePlaced();
  void noteWorkOn(std::uint32_t pair);
  void saveState(std::uint64_t number);
  [[nodiscard]] MapState state() const;
  [[nodiscard]] MapperFigures figures() const;

  MissionRun& run_;
  Links links_;
  Config config_;
  rt::OverloadRule rule_;
  rt::Clock& clock_;
  rt::StageTimes stages_;
  std::optional<std::uint64_t> awaited_;  // number of the restart's mark
  std::uint64_t awaited_from_ = 0;
  std::int64_t work_begin_ns_ = 0, stage_begin_ns_ = 0, stage_end_ns_ = 0;  // monotonic
  std::optional<std::int64_t> arrival_ns_;  // of the pair that is being looked at [UTC]
  std::int64_t seeing_ns_ = 0;              // time that see() of the newest pair took
  std::int64_t last_frame_ns_ = 0;          // time of the last pair in all
  std::int64_t lag_ns_ = 0, highest_lag_ns_ = 0;
  std::int64_t published_ns_ = 0, figures_ns_ = 0;
  std::int64_t saved_ns_ = INT64_MIN / 2;
};

}  // namespace fathom::onboard
