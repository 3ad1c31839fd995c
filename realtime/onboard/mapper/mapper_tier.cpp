#include "realtime/onboard/mapper/mapper_tier.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/fault_point.hpp"
#include "realtime/onboard/mission_run.hpp"

namespace fathom::onboard {
namespace {

// The stages that OnboardSystem and its cores name, then whole ones of this tier.
constexpr std::size_t kMap = 11, kPair = 12, kArrivalToMap = 13, kLink = 14, kCheckpoint = 15;
constexpr std::int64_t kPublishInterval = 100'000'000, kFiguresInterval = kSecond_ns;  // [ns]

}  // namespace

const std::array<rt::StageSpec, MapperTier::kStages>& MapperTier::stageSpecs() {
  // A pair in less than the time between two.
  constexpr std::int64_t kPairDeadline = 500'000'000;  // [ns]
  static constexpr rt::StageSpec kSpecs[] = {
      {"images", 0},           {"lighting", 0},       {"stereo", 0},          {"lighting learns", 0},
      {"features", 0},         {"features given", 0}, {"visual odometry", 0}, {"graph", 0},
      {"candidates", 0},       {"closures", 0},       {"map rebuild", 0},     {"map", 0},
      {"pair", kPairDeadline}, {"arrival to map", 0}, {"link and rows", 0},   {"checkpoint", 0}};
  static const auto specs = std::to_array(kSpecs);
  return specs;
}

rt::StageSummary MapperTier::summaryOf(const MapperFigures& figures, std::size_t stage) {
  const MapperFigures::Stage& s = figures.stages[stage];
  return {stageSpecs()[stage].name, s.count, s.misses, s.last_ns, s.p50_ns, s.p99_ns, s.max_ns};
}

bool RingFramePort::send(std::span<const std::uint8_t> frame) noexcept {
  if (muted_) return true;
  OutgoingFrame out;
  if (frame.empty() || frame.size() > out.bytes.size()) return false;
  out.size = static_cast<std::uint16_t>(frame.size());
  std::copy(frame.begin(), frame.end(), out.bytes.begin());
  return ring_.push(out);
}

MapperTier::MapperTier(MissionRun& run, const Links& links, const Config& config, rt::Clock& clock)
    : run_(run),
      links_(links),
      config_(config),
      rule_(config.overload),
      clock_(clock),
      stages_(stageSpecs()) {
  run_.system().setPairPolicy([this](const StereoTrigger& trigger, const OnboardSystem::MappedPair& pair) {
    return decide(trigger, pair);
  });
  run_.system().setPlacingObserver([this](std::uint32_t pair) { noteWorkOn(pair); });
  run_.setObservers([this](const char* stage) { noteStage(stage); },
                    [this](const OnboardSystem::MappedPair& pair) { noteSeen(pair); },
                    [this](const OnboardSystem::MappedPair&) { notePlaced(); });
}

void MapperTier::awaitMark(std::uint64_t number, std::uint64_t from) {
  awaited_ = number;
  awaited_from_ = from;
  links_.modem->setMuted(true);
}

std::optional<io::Decision> MapperTier::decidedBefore(std::uint32_t pair) const {
  if (const auto decided = links_.channel->up().decided.of(pair)) return decided;
  return links_.feed->decisionOf(pair);
}

OnboardSystem::PairQuota MapperTier::decide(const StereoTrigger& trigger,
                                            const OnboardSystem::MappedPair& pair) {
  rt::OverloadRule::Observation seen;
  seen.period_ns = config_.pair_period_ns;
  seen.last_frame_ns = last_frame_ns_;
  seen.waiting = static_cast<int>(lag_ns_ / config_.pair_period_ns);
  // Since the pair could have been mapped: a DVL that lets it wait is no overload.
  seen.age_ns = lag_ns_;
  work_begin_ns_ = stage_begin_ns_ = clock_.monotonicNs();
  arrival_ns_ = links_.frames->arrivalOf(pair.left_image, pair.right_image);
  const std::optional<io::Decision> before = decidedBefore(trigger.pair_index);
  io::Decision decision;
  decision.pair_index = trigger.pair_index;
  if (before) {
    decision = *before;
  } else if (!awaited_) {
    const rt::OverloadRule::Decided decided = rule_.decide(seen);
    decision.level = static_cast<std::uint8_t>(decided.level);
    decision.dropped = decided.drop;
  }
  // A pair whose pixels had to be given back, and are not on the disk either, cannot be mapped.
  if (!decision.dropped) {
    const auto has = [&](const std::string& name, CameraSide side) { return links_.has_pixels(name, side); };
    decision.dropped = !has(pair.left_image, CameraSide::kLeft) || !has(pair.right_image, CameraSide::kRight);
  }
  const bool known = before && before->dropped == decision.dropped;
  if ((decision.level > 0 || decision.dropped) && !known) links_.channel->up().decide(run_.nowNs(), decision);

  if (decision.dropped)
    links_.frames->release(pair.left_image, pair.right_image);
  else
    noteWorkOn(trigger.pair_index);
  return pairQuota(decision);
}

void MapperTier::addStage(std::size_t stage, std::int64_t begin_ns, std::int64_t end_ns) {
  stages_.add(stage, begin_ns, end_ns);
  links_.channel->up().timeline.push({static_cast<std::uint16_t>(stage), begin_ns, end_ns});
}

void MapperTier::noteStage(const char* stage) {
  const std::int64_t now = clock_.monotonicNs();
  const auto& specs = stageSpecs();
  for (std::size_t i = 0; i < kPair; ++i)
    if (std::strcmp(specs[i].name, stage) == 0) addStage(i, stage_begin_ns_, now);
  if (arrival_ns_ && std::strcmp(stage, specs[kMap].name) == 0)
    addStage(kArrivalToMap, now - (clock_.utcNs() - *arrival_ns_), now);
  stage_begin_ns_ = stage_end_ns_ = now;
  rt::faultPoint(stage);
  beat();
}

void MapperTier::noteSeen(const OnboardSystem::MappedPair& pair) {
  const std::int64_t now = clock_.monotonicNs();
  seeing_ns_ = now - work_begin_ns_;
  work_begin_ns_ = now;
  arrival_ns_.reset();
  links_.frames->release(pair.left_image, pair.right_image);
  links_.channel->up().working_pair.store(0, std::memory_order_relaxed);
}

// Should the mapper die now, it is of this pair.
void MapperTier::noteWorkOn(std::uint32_t pair) {
  links_.channel->up().working_pair.store(std::uint64_t{pair} + 1, std::memory_order_relaxed);
}

// A pair's work is to see it and, later, to place it.
void MapperTier::notePlaced() {
  const std::int64_t now = clock_.monotonicNs();
  last_frame_ns_ = seeing_ns_ + now - work_begin_ns_;
  work_begin_ns_ = now;
  stages_.add(kPair, now - last_frame_ns_, now);
  links_.channel->up().working_pair.store(0, std::memory_order_relaxed);
}

void MapperTier::consume(const io::OnboardInput& input, std::uint64_t position) {
  lag_ns_ = std::max<std::int64_t>(0, clock_.utcNs() - input.arrival_utc_ns);
  if (!awaited_) highest_lag_ns_ = std::max(highest_lag_ns_, lag_ns_);
  if (io::imageOf(input) != nullptr) links_.frames->refill();
  work_begin_ns_ = stage_begin_ns_ = clock_.monotonicNs();
  run_.consume(input);
  const auto* mark = std::get_if<io::Mark>(&input.what);
  if (mark == nullptr) return;
  if (mark->kind == io::Mark::Kind::kRestart && awaited_ == mark->number && position >= awaited_from_) {
    awaited_.reset();
    run_.system().setMapping(true);
    links_.modem->setMuted(false);
    links_.channel->up().enter(MapperPhase::kRunning);
  }
  if (mark->kind == io::Mark::Kind::kCheckpoint) saveState(mark->number);
}

void MapperTier::saveState(std::uint64_t number) {
  const std::int64_t begin = clock_.monotonicNs();
  // A log that is caught up with has the marks of hours.
  if (begin - saved_ns_ < config_.checkpoint_ns / 2) return;
  if (links_.output_lost() || !run_.readyToSave()) return;
  run_.forgetSlots(links_.checkpoints->oldest());
  const std::span<std::uint8_t> buffer = links_.checkpoints->begin();
  if (buffer.empty()) return;
  saved_ns_ = begin;
  rt::StateWriter writer(buffer);
  run_.save(writer);
  if (writer.full())
    links_.checkpoints->giveUp();
  else
    links_.checkpoints->submit({links_.configuration, links_.mission, number, run_.inputs(), run_.nowNs()},
                               writer.size(),
                               links_.channel->up().decisions_made.load(std::memory_order_relaxed));
  addStage(kCheckpoint, begin, clock_.monotonicNs());
}

std::size_t MapperTier::work(std::size_t most) {
  std::size_t done = 0;
  io::OnboardInput input;
  const std::int64_t begin = clock_.monotonicNs();
  while (done < most && !ended()) {
    const std::uint64_t position = links_.feed->position();
    if (!links_.feed->next(input)) break;
    consume(input, position);
    ++done;
    links_.channel->up().position.store(links_.feed->position(), std::memory_order_relaxed);
  }
  const std::int64_t now = clock_.monotonicNs();
  rt::faultPoint("link");
  if (done > 0) addStage(kLink, std::max(begin, stage_end_ns_), now);
  beat();
  if (now - published_ns_ >= kPublishInterval) publish();
  return done;
}

void MapperTier::beat() noexcept {
  std::atomic<std::uint64_t>& beats = links_.channel->up().beats;
  beats.store(beats.load(std::memory_order_relaxed) + 1, std::memory_order_release);
}

void MapperTier::publish() {
  published_ns_ = clock_.monotonicNs();
  links_.channel->up().state.write(state());
  if (published_ns_ - figures_ns_ < kFiguresInterval) return;
  figures_ns_ = published_ns_;
  links_.channel->up().figures.write(figures());
}

MapState MapperTier::state() const {
  const OnboardSystem& system = run_.system();
  MapState state;
  state.utc_ns = run_.nowNs();
  state.T_nav_odom = system.map().T_nav_odom();
  state.anchored = system.map().anchored();
  state.status = system.status(run_.nowNs());
  state.mapped_area = system.link().mappedArea();
  state.pairs = system.map().counters().pairs;
  state.pairs_shed = rule_.statistics().dropped;
  if (const LocalisationCore* localisation = system.map().localisation()) {
    state.keyframes = static_cast<std::uint64_t>(localisation->keyframes());
    state.closures = localisation->graph().counters().closures;
  }
  state.map_meshes_moved = system.map().movingMap().counters().meshes_fused_again;
  const fusion::QuadtreeMap::Counters map = system.map().map().counters();
  state.map_tiles = map.tiles_used;
  state.map_tiles_high_water = map.tiles_high_water;
  state.map_layers = map.layers_used;
  state.map_layers_high_water = map.layers_high_water;
  state.map_coarsened = map.coarsened;
  state.map_refused = map.refused;
  const telemetry::LinkScheduler::Counters link = system.link().counters();
  state.link_frames = link.frames;
  state.link_bytes = link.bytes;
  state.link_blocks_waiting = link.blocks_waiting;
  state.link_frames_arrived = link.frames_arrived;
  state.level = rule_.level();
  state.lag_ns = lag_ns_;
  state.highest_lag_ns = highest_lag_ns_;
  state.frames_given_back = links_.frames->givenBackUnused();
  state.inputs_skipped = links_.feed->skipped();
  state.inputs_passed_over = links_.feed->passedOver();
  state.rows_lost = links_.output_lost() ? 1 : 0;
  return state;
}

MapperFigures MapperTier::figures() const {
  MapperFigures figures;
  for (std::size_t i = 0; i < kStages; ++i) {
    const rt::StageSummary s = stages_.summary(i);
    figures.stages[i] = {
        s.count, s.misses, s.last_ns, s.p50_ns, s.p99_ns, stages_.histogram(i).percentile(99.9), s.max_ns};
  }
  figures.overload = rule_.statistics();
  figures.checkpoints = links_.checkpoints->counters();
  links_.memory(figures);
  return figures;
}

}  // namespace fathom::onboard
