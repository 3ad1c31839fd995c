#include "realtime/onboard/live/soft_tier.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "realtime/kernel/state_archive.hpp"
#include "realtime/onboard/pair_quota.hpp"

namespace fathom::onboard {
namespace {

// The stages that OnboardSystem and its cores name, then whole ones of this tier.
constexpr std::size_t kPair = 12, kArrivalToMap = 13, kLink = 14, kCheckpoint = 15;
constexpr std::int64_t kPublishInterval = 100'000'000;  // [ns]

}  // namespace

const std::array<rt::StageSpec, SoftTier::kStages>& SoftTier::stageSpecs() {
  // A pair in less than the time between two.
  constexpr std::int64_t kPairDeadline = 500'000'000;  // [ns]
  static const std::array<rt::StageSpec, kStages> specs = {{{"images", 0},
                                                            {"lighting", 0},
                                                            {"stereo", 0},
                                                            {"lighting learns", 0},
                                                            {"features", 0},
                                                            {"features given", 0},
                                                            {"visual odometry", 0},
                                                            {"graph", 0},
                                                            {"candidates", 0},
                                                            {"closures", 0},
                                                            {"map rebuild", 0},
                                                            {"map", 0},
                                                            {"pair", kPairDeadline},
                                                            {"arrival to map", 0},
                                                            {"link and rows", 0},
                                                            {"checkpoint", 0}}};
  return specs;
}

SoftTier::SoftTier(MissionRun& run, const Links& links, const rt::OverloadConfig& overload,
                   std::int64_t pair_period_ns, rt::Clock& clock, rt::StageTimes& stages)
    : run_(run), links_(links), rule_(overload), period_ns_(pair_period_ns), clock_(clock), stages_(stages) {
  run_.system().setPairPolicy([this](const StereoTrigger& trigger, const OnboardSystem::MappedPair& pair) {
    return decide(trigger, pair);
  });
  run_.setObservers([this](const char* stage) { noteStage(stage); },
                    [this](const OnboardSystem::MappedPair& pair) { noteMapped(pair); });
}

OnboardSystem::PairQuota SoftTier::decide(const StereoTrigger& trigger,
                                          const OnboardSystem::MappedPair& pair) {
  rt::OverloadRule::Observation seen;
  seen.period_ns = period_ns_;
  seen.last_frame_ns = last_frame_ns_;
  seen.waiting = static_cast<int>(lag_ns_ / period_ns_);
  // Since the pair could have been mapped: a DVL that lets it wait is no overload.
  seen.age_ns = lag_ns_;
  pair_begin_ns_ = stage_begin_ns_ = clock_.monotonicNs();
  if (!caughtUp()) {
    const auto found = resume_.decisions.find(trigger.pair_index);
    return found == resume_.decisions.end() ? OnboardSystem::PairQuota() : pairQuota(found->second);
  }
  const rt::OverloadRule::Decided decided = rule_.decide(seen);
  io::Decision decision;
  decision.pair_index = trigger.pair_index;
  decision.level = static_cast<std::uint8_t>(decided.level);
  // A pair whose pixels had to be given back cannot be mapped either.
  decision.dropped = decided.drop || !links_.has_pixels(pair.left_image, CameraSide::kLeft) ||
                     !links_.has_pixels(pair.right_image, CameraSide::kRight);
  if ((decision.level > 0 || decision.dropped) && links_.recorder != nullptr)
    (void)links_.recorder->offerDecision({run_.nowNs(), decision});
  if (decision.dropped) links_.frames->release(pair.left_image, pair.right_image);
  return pairQuota(decision);
}

void SoftTier::noteStage(const char* stage) {
  const std::int64_t now = clock_.monotonicNs();
  const auto& specs = stageSpecs();
  for (std::size_t i = 0; i < kPair; ++i)
    if (std::strcmp(specs[i].name, stage) == 0) stages_.add(i, stage_begin_ns_, now);
  stage_begin_ns_ = now;
}

void SoftTier::noteMapped(const OnboardSystem::MappedPair& pair) {
  const std::int64_t now = clock_.monotonicNs();
  last_frame_ns_ = now - pair_begin_ns_;
  stages_.add(kPair, pair_begin_ns_, now);
  if (const auto arrival = links_.frames->arrivalOf(pair.left_image, pair.right_image))
    stages_.add(kArrivalToMap, now - (clock_.utcNs() - *arrival), now);
  links_.frames->release(pair.left_image, pair.right_image);
}

void SoftTier::consume(const io::OnboardInput& input) {
  lag_ns_ = std::max<std::int64_t>(0, clock_.utcNs() - input.arrival_utc_ns);
  highest_lag_ns_ = std::max(highest_lag_ns_, lag_ns_);
  if (io::imageOf(input) != nullptr) links_.frames->refill();
  run_.consume(input);
  if (const auto* mark = std::get_if<io::Mark>(&input.what))
    if (mark->kind == io::Mark::Kind::kCheckpoint) saveState(mark->number);
}

void SoftTier::saveState(std::uint64_t number) {
  if (links_.checkpoints == nullptr || !run_.readyToSave()) return;
  run_.forgetSlots(links_.checkpoints->oldest());
  const std::span<std::uint8_t> buffer = links_.checkpoints->begin();
  if (buffer.empty()) return;
  const std::int64_t begin = clock_.monotonicNs();
  rt::StateWriter writer(buffer);
  run_.save(writer);
  if (writer.full())
    links_.checkpoints->giveUp();
  else
    links_.checkpoints->submit(
        {links_.names.configuration, links_.names.mission, number, run_.inputs(), run_.nowNs()},
        writer.size());
  stages_.add(kCheckpoint, begin, clock_.monotonicNs());
}

void SoftTier::catchUpWith(Resume resume) {
  resume_ = std::move(resume);
  links_.modem->setMuted(true);
  caught_up_.store(false, std::memory_order_release);
}

std::size_t SoftTier::catchUp(std::size_t most) {
  std::size_t done = 0;
  for (; done < most && next_of_tail_ < resume_.tail.size(); ++done)
    run_.consume(resume_.tail[next_of_tail_++]);
  if (next_of_tail_ < resume_.tail.size()) return done;
  resume_ = {};
  links_.modem->setMuted(false);
  caught_up_.store(true, std::memory_order_release);
  return done;
}

std::size_t SoftTier::work(std::size_t most) {
  if (!caughtUp()) return catchUp(most);
  std::size_t done = 0;
  io::OnboardInput input;
  const std::int64_t begin = clock_.monotonicNs();
  while (done < most && !run_.ended() && links_.sequence->pop(input)) {
    consume(input);
    ++done;
  }
  const std::int64_t now = clock_.monotonicNs();
  if (done > 0) stages_.add(kLink, std::max(begin, stage_begin_ns_), now);
  if (now - published_ns_ >= kPublishInterval) publish(now);
  return done;
}

void SoftTier::publish(std::int64_t now_ns) {
  published_ns_ = now_ns;
  stages_.publish();
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
  for_bus_.write(state);
  for_supervisor_.write(state);
}

}  // namespace fathom::onboard
