#include "realtime/onboard/live/supervisor.hpp"

#include <cstdlib>

#include "telemetry/wire/status.hpp"

namespace fathom::onboard {
namespace {

constexpr std::int64_t kClockStep_ns = 100'000'000;  // the system's clock was set, not steered

}  // namespace

void Supervisor::begin(bool complete) {
  complete_ = complete;
  const std::int64_t now = links_.clock->monotonicNs();
  next_checkpoint_ns_ = now + checkpoint_ns_;
  links_.threads->watchFrom(now);
  told_health_ = programHealth(0);
  (void)links_.hard->mark({io::Mark::Kind::kHealth, told_health_});
}

std::uint64_t Supervisor::programHealth(std::uint64_t slipped) const {
  std::uint64_t flags = slipped << 16U;
  if (!complete_) flags |= telemetry::kHealthSoftRealTime;
  if (links_.soft->overload().level() != rt::DegradationLevel::kFull) flags |= telemetry::kHealthOverload;
  const io::Recorder::Counters recorded = links_.recorder->counters();
  if (recorded.inputs_dropped + recorded.decisions_dropped + recorded.images_dropped_disk +
          recorded.images_dropped_queue + recorded.write_failures >
      0)
    flags |= telemetry::kHealthRecorderFailed;
  if (links_.recorder->disk() != io::Recorder::Disk::kRoom) flags |= telemetry::kHealthDiskLow;
  return flags;
}

std::vector<std::string> Supervisor::step(std::uint64_t slipped) {
  std::vector<std::string> events;
  const std::int64_t now = links_.clock->monotonicNs();
  links_.threads->look(now, events);
  const std::int64_t clock_step = links_.clock->systemStepNs();
  if (std::abs(clock_step - last_step_ns_) > kClockStep_ns) {
    ++clock_steps_;
    events.push_back("the system's clock was set by " +
                     std::to_string(static_cast<double>(clock_step - last_step_ns_) * 1e-9) +
                     " s; the vehicle's time goes on unchanged");
  }
  last_step_ns_ = clock_step;
  if (now >= next_checkpoint_ns_ && links_.soft->caughtUp() &&
      links_.hard->mark({io::Mark::Kind::kCheckpoint, next_})) {
    ++next_;
    next_checkpoint_ns_ = now + checkpoint_ns_;
  }
  const std::uint64_t health = programHealth(slipped);
  if (health != told_health_ && links_.hard->mark({io::Mark::Kind::kHealth, health})) told_health_ = health;
  return events;
}

}  // namespace fathom::onboard
