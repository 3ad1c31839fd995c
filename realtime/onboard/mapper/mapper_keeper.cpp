#include "realtime/onboard/mapper/mapper_keeper.hpp"

#include <algorithm>

namespace fathom::onboard {
namespace {

constexpr std::int64_t kWorks_ns =
    50'000'000;  // what a process works that only waits takes minutes to come to

}  // namespace

void MapperKeeper::learnFrom(const Seen& seen, Orders& orders) {
  orders.lost = true;
  const bool further = seen.position > furthest_;
  furthest_ = std::max(furthest_, seen.position);
  futile_ = further ? 0 : futile_ + 1;
  if (seen.phase == MapperPhase::kLoading && seen.loading != 0) orders.avoid = seen.loading;
  const bool follows = seen.phase == MapperPhase::kCatchingUp || seen.phase == MapperPhase::kRunning;
  const std::uint64_t pair = follows ? seen.working_pair : 0;
  if (pair != 0 && pair == died_on_pair_) {
    orders.drop_pair = static_cast<std::uint32_t>(pair - 1);
    died_on_pair_ = 0;
  } else {
    died_on_pair_ = pair;
  }
  const std::int64_t doubled = config_.first_wait_ns << std::min(futile_ - 1, 20);
  const std::int64_t wait = futile_ == 0 ? 0 : std::min(doubled, config_.longest_wait_ns);
  // One that found what a person must put right is not asked ten times a second.
  const bool refused = seen.phase == MapperPhase::kRefused && !killed_;
  next_start_ns_ = seen.now_ns + (refused ? config_.longest_wait_ns / 3 : wait);
}

MapperKeeper::Orders MapperKeeper::step(const Seen& seen) {
  Orders orders;
  if (done_) return orders;
  if (seen.running) {
    const bool finishes = seen.phase == MapperPhase::kFinishing;
    // That of a process that is gone, or nonsense: it has so long to be gone.
    const bool over = seen.phase >= MapperPhase::kEnded;
    const bool works = finishes && seen.cpu_ns - cpu_ns_ >= kWorks_ns;
    if (seen.phase != phase_ || (!over && seen.beats != beats_) || works) {
      last_life_ns_ = seen.now_ns;
      cpu_ns_ = seen.cpu_ns;
    }
    beats_ = seen.beats;
    phase_ = seen.phase;
    if (killed_) return orders;
    const bool follows = seen.phase == MapperPhase::kCatchingUp || seen.phase == MapperPhase::kRunning;
    const std::int64_t limit = follows || over ? config_.stuck_after_ns : config_.start_within_ns;
    if (seen.now_ns - last_life_ns_ <= limit) return orders;
    orders.kill = killed_ = true;
    orders.why = "the mapper got no further for " + std::to_string(limit / 1'000'000) + " ms";
    return orders;
  }
  if (was_running_) {
    was_running_ = false;
    if (seen.phase == MapperPhase::kEnded || seen.phase == MapperPhase::kNoMap) {
      done_ = true;
      return orders;
    }
    learnFrom(seen, orders);
    killed_ = false;
  }
  if (seen.now_ns < next_start_ns_) return orders;
  orders.start = true;
  orders.from_empty = futile_ >= config_.futile_starts;
  if (orders.from_empty) futile_ = 0;
  ++starts_;
  // One that does not come to be has died at once.
  was_running_ = true;
  last_life_ns_ = seen.now_ns;
  return orders;
}

}  // namespace fathom::onboard
