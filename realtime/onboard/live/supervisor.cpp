#include "realtime/onboard/live/supervisor.hpp"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "realtime/kernel/fault_point.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kClockStep_ns = 100'000'000;  // the system's clock was set, not steered
// A mapper that is behind by no more has caught up; one that cannot come so near is let speak all the same.
constexpr std::uint64_t kNearInputs = 64;
constexpr std::uint64_t kMostUnsafe = 1U << 16U;  // decisions that the disk does not hold yet
constexpr std::int64_t kLongestSilence_ns = 60'000'000'000;

PartState stateOf(MapperPhase phase) {
  switch (phase) {
    case MapperPhase::kStarting:
    case MapperPhase::kLoading:
      return PartState::kStarting;
    case MapperPhase::kCatchingUp:
      return PartState::kCatchingUp;
    case MapperPhase::kRunning:
    case MapperPhase::kFinishing:
      return PartState::kRunning;
    case MapperPhase::kEnded:
    case MapperPhase::kNoMap:
      return PartState::kEnded;
    case MapperPhase::kRefused:
      break;
  }
  return PartState::kFailed;
}

}  // namespace

MapperPhase Supervisor::phase() const {
  return links_.channel->up().current();
}

void Supervisor::begin(bool complete) {
  complete_ = complete;
  begun_ = true;
  const std::int64_t now = links_.clock->monotonicNs();
  next_checkpoint_ns_ = now + checkpoint_ns_;
  links_.threads->watchFrom(now);
  reported_health_ = programHealth(0);
  (void)links_.hard->mark({io::Mark::Kind::kHealth, reported_health_});
  // A continued dive: the mapper of the earlier run is gone.
  if (!links_.channel->down().fresh.load()) (void)links_.hard->mark({io::Mark::Kind::kMapperLost, 0});
}

std::uint64_t Supervisor::programHealth(std::uint64_t skipped) const {
  std::uint64_t flags = skipped << 16U;
  if (!complete_) flags |= telemetry::kHealthSoftRealTime;
  MapState map;
  const bool known = links_.channel->up().readMap(map);
  if (known && map.level != rt::DegradationLevel::kFull) flags |= telemetry::kHealthOverload;
  if (stateOf(phase()) != PartState::kRunning) flags |= telemetry::kHealthNoMap;
  if (clock_health_.unsure()) flags |= telemetry::kHealthClockUnsure;
  const io::Recorder::Counters recorded = links_.recorder->counters();
  if (recorded.inputs_dropped + recorded.decisions_dropped + recorded.images_dropped_disk +
              recorded.images_dropped_queue + recorded.write_failures + map.rows_lost >
          0 ||
      links_.recorder->state() == io::Recorder::State::kFailed)
    flags |= telemetry::kHealthRecorderFailed;
  if (links_.recorder->disk() != io::Recorder::Disk::kRoom) flags |= telemetry::kHealthDiskLow;
  return flags;
}

MapperKeeper::Seen Supervisor::look() const {
  const MapperUp& up = std::as_const(*links_.channel).up();
  MapperKeeper::Seen seen;
  seen.now_ns = links_.clock->monotonicNs();
  seen.running = links_.child->running();
  seen.phase = phase();
  seen.beats = up.beats.load();
  // Of another process: what it cannot have consumed is nonsense.
  seen.position = std::min(up.position.load(), links_.channel->down().inputs.next());
  seen.cpu_ns = links_.child->cpuNs();
  seen.loading = up.loading.load();
  seen.working_pair = up.working_pair.load();
  return seen;
}

void Supervisor::startMapper(bool from_empty, std::vector<std::string>& events) {
  MapperUp& up = links_.channel->up();
  MapperDown& down = links_.channel->down();
  up.enter(MapperPhase::kStarting);
  up.begun_with.store(0);
  up.loading.store(0);
  up.working_pair.store(0);
  // More than can be pending is nonsense, and would prevent every state from being saved.
  const std::uint64_t safe = down.decisions_safe.load(), made = up.decisions_made.load();
  if (made < safe || made - safe > kMostUnsafe) up.decisions_made.store(safe);
  down.from_empty.store(from_empty);
  if (starts_.load() > 0) down.fresh.store(false);
  restart_marked_ = down.fresh.load();
  mapper_started_ns_ = links_.clock->monotonicNs();
  if (from_empty) events.emplace_back("the mapper got no further again and again; it begins at the present");
  if (const std::string why = links_.child->start(); !why.empty()) {
    mapper_reason_ = "cannot be started: " + why;
    events.push_back("the mapper " + mapper_reason_);
    return;
  }
  starts_.fetch_add(1);
}

// As if the mapper had decided it: there is none, so nobody else gives decisions.
void Supervisor::dropPair(std::uint32_t pair) {
  links_.channel->up().decide(links_.clock->utcNs(), {pair, 0, true});
}

void Supervisor::stepMapper(std::vector<std::string>& events) {
  if (const auto ended = links_.child->ended()) mapper_reason_ = "ended by " + *ended;
  const MapperKeeper::Orders orders = keeper_.step(look());
  if (orders.kill) {
    events.push_back(orders.why + "; it is killed");
    links_.child->kill();
  }
  if (orders.lost) {
    lost_marked_ = false;
    events.push_back("the mapper is lost (" + mapper_reason_ + "); navigation and recording continue");
  }
  if (orders.avoid) {
    auto& avoid = links_.channel->down().avoid;
    avoid[1].store(avoid[0].load());
    avoid[0].store(*orders.avoid);
  }
  if (orders.drop_pair) {
    events.push_back("the mapper died twice of pair " + std::to_string(*orders.drop_pair) +
                     ", which is left out");
    dropPair(*orders.drop_pair);
  }
  if (orders.start && !restarts_stopped_) startMapper(orders.from_empty, events);
  if (!begun_) return;
  if (!lost_marked_) lost_marked_ = links_.hard->mark({io::Mark::Kind::kMapperLost, 0});
  if (!restart_marked_ && lost_marked_) markRestart(events);
}

void Supervisor::markRestart(std::vector<std::string>& events) {
  const MapperUp& up = std::as_const(*links_.channel).up();
  const std::uint64_t begun_with = up.begun_with.load();
  if (begun_with == 0 || !links_.child->running()) return;
  const std::int64_t now = links_.clock->monotonicNs();
  const std::uint64_t next = links_.channel->down().inputs.next();
  const bool near = up.position.load() + kNearInputs >= next;
  if (!near && now - mapper_started_ns_ < kLongestSilence_ns) return;
  telemetry::Version next_frame = 0;
  if (links_.own_status->nextVersion(next_frame) && !links_.hard->mark({io::Mark::Kind::kSent, next_frame}))
    return;
  restart_marked_ = links_.hard->mark({io::Mark::Kind::kRestart, begun_with - 1});
  if (!restart_marked_) return;
  const std::uint64_t number = begun_with - 1;
  events.push_back("the mapper continues " +
                   (number == io::Mark::kEmptyMap ? std::string("with an empty map")
                    : number == 0                 ? std::string("from the log's beginning")
                                                  : "from checkpoint " + std::to_string(number)) +
                   ", " + std::to_string((now - mapper_started_ns_) / 1'000'000) + " ms after its start");
}

// Why a part whose thread is alive does not do its work; "" where it does.
std::string Supervisor::refusalOf(const std::string& part) const {
  if (part == "recorder")
    return links_.recorder->state() == io::Recorder::State::kFailed ? links_.recorder->failure() : "";
  for (const io::DeviceHealth& device : links_.devices())
    if (device.name == part && !device.open)
      return device.reason.empty() ? "is not there" : std::string(device.reason.view());
  return "";
}

void Supervisor::notePartStates(std::vector<std::string>& events) {
  PartStates& parts = *links_.parts;
  const rt::Watchdog& watchdog = links_.threads->watchdog();
  for (std::size_t i = 0; i < watchdog.tiers(); ++i) {
    const rt::Watchdog::TierState& tier = watchdog.state(i);
    const std::string name = tier.spec.name, left = links_.threads->reasonOf(name);
    const std::string why = tier.stuck ? (left.empty() ? "gives no sign of life" : left) : refusalOf(name);
    if (!parts.set(name, why.empty() ? PartState::kRunning : PartState::kFailed, why)) continue;
    events.push_back(name + (why.empty() ? " is running" : " failed: " + why));
  }
  const bool running = links_.child->running();
  const PartState mapper = running || keeper_.done() ? stateOf(phase()) : PartState::kFailed;
  if (parts.set("mapper", mapper, mapper == PartState::kFailed ? mapper_reason_ : "") &&
      mapper == PartState::kRunning && starts_.load() > 1)
    events.emplace_back("the map continues");
  MapState map;
  (void)links_.channel->up().readMap(map);
  const PartState of_map = mapper == PartState::kFailed ? PartState::kFailed : mapper;
  parts.set("link", of_map, of_map == PartState::kFailed ? "no mapper" : "");
  parts.set("output", map.rows_lost > 0 ? PartState::kFailed : of_map,
            map.rows_lost > 0 ? "the disk refused rows" : (of_map == PartState::kFailed ? "no mapper" : ""));
}

std::vector<std::string> Supervisor::step(std::uint64_t skipped) {
  rt::faultPoint("supervisor");
  std::vector<std::string> events;
  const std::int64_t now = links_.clock->monotonicNs();
  links_.threads->look(now, events);
  clock_health_.look(rt::clockState(*links_.clock));
  const std::int64_t clock_step = links_.clock->systemStepNs();
  if (std::abs(clock_step - last_step_ns_) > kClockStep_ns) {
    ++clock_steps_;
    events.push_back("the system's clock was set by " +
                     std::to_string(static_cast<double>(clock_step - last_step_ns_) * 1e-9) +
                     " s; the vehicle's time continues unchanged");
  }
  last_step_ns_ = clock_step;
  stepMapper(events);
  notePartStates(events);
  if (now >= next_checkpoint_ns_ && links_.hard->mark({io::Mark::Kind::kCheckpoint, next_})) {
    ++next_;
    next_checkpoint_ns_ = now + checkpoint_ns_;
  }
  const std::uint64_t health = programHealth(skipped);
  if (health != reported_health_ && links_.hard->mark({io::Mark::Kind::kHealth, health}))
    reported_health_ = health;
  return events;
}

}  // namespace fathom::onboard
