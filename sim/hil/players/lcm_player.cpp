#include "sim/hil/players/lcm_player.hpp"

#include <lcm/lcm.h>

#include <algorithm>
#include <type_traits>

#include "firmware_if/mission/log/log_messages.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::sim {
namespace {

struct CloseLcm {
  void operator()(lcm_t* lcm) const { ::lcm_destroy(lcm); }
};

// DVL samples use the serial line, fixes the modem.
bool isPublished(const SensorSample& sample) {
  return !std::holds_alternative<DvlSample>(sample) && !std::holds_alternative<UsblFix>(sample);
}

}  // namespace

struct LcmPlayer::Impl {
  const MissionSchedule& schedule;
  FaultScript script;
  SimulatedVehicleClock& clock;
  std::unique_ptr<lcm_t, CloseLcm> lcm;
  Counters counters;
};

LcmPlayer::LcmPlayer(const MissionSchedule& schedule, const FaultScript& script, SimulatedVehicleClock& clock,
                     const std::string& provider)
    : impl_(new Impl{
          schedule, script, clock, std::unique_ptr<lcm_t, CloseLcm>(::lcm_create(provider.c_str())), {}}) {
  if (!impl_->lcm)
    throw InputError("--lcm " + provider, "", "LCM cannot use this provider; give udpm://ADDRESS:PORT?ttl=0");
}
LcmPlayer::~LcmPlayer() = default;

void LcmPlayer::run(const std::atomic<bool>& stop) {
  Impl& i = *impl_;
  for (const ScheduledSample& scheduled : i.schedule.samples) {
    if (!isPublished(scheduled.sample)) continue;
    if (!i.clock.sleepUntil(scheduled.due_utc_ns, stop)) return;
    const std::int64_t now_ns = i.clock.utcNs();
    i.counters.worst_late_ns = std::max(i.counters.worst_late_ns, now_ns - scheduled.due_utc_ns);
    if (i.script.at(FaultKind::kCanBusOff, i.schedule.missionSeconds(scheduled.due_utc_ns)) != nullptr) {
      ++i.counters.withheld;
      continue;
    }
    const io::LogMessage message = io::encodeSample(now_ns, scheduled.sample);
    const int result = ::lcm_publish(i.lcm.get(), message.channel.c_str(), message.data.data(),
                                     static_cast<unsigned>(message.data.size()));
    ++(result == 0 ? i.counters.messages : i.counters.refused);
  }
}

const LcmPlayer::Counters& LcmPlayer::counters() const {
  return impl_->counters;
}

}  // namespace fathom::sim
