#include "realtime/onboard/live/hard_tier.hpp"

#include <algorithm>
#include <cassert>

namespace fathom::onboard {
namespace {

constexpr std::int64_t kHealthInterval = 500'000'000;  // [ns]

}  // namespace

void InputSequencer::add(InputRing& ring) noexcept {
  assert(count_ < kMaxRings);
  heads_[count_++].ring = &ring;
}

bool InputSequencer::next(io::OnboardInput& input) noexcept {
  Head* first = nullptr;
  for (std::size_t i = 0; i < count_; ++i) {
    Head& head = heads_[i];
    if (!head.filled) head.filled = head.ring->pop(head.input);
    if (head.filled && (first == nullptr || head.input.arrival_utc_ns < first->input.arrival_utc_ns))
      first = &head;
  }
  if (first == nullptr) return false;
  input = first->input;
  first->filled = false;
  last_ns_ = input.arrival_utc_ns = std::max(input.arrival_utc_ns, last_ns_);
  return true;
}

io::OnboardInput InputSequencer::own(std::int64_t now_ns, const io::OnboardInput::What& what) noexcept {
  last_ns_ = std::max(now_ns, last_ns_);
  return {last_ns_, what};
}

HardTier::HardTier(const NavCoreConfig& nav, const Links& links, rt::Clock& clock, rt::StageTimes& stages)
    : links_(links), clock_(clock), stages_(stages), nav_(nav) {}

void HardTier::cycle() noexcept {
  if (ended_.load(std::memory_order_relaxed)) return giveMarks();
  const std::int64_t begin = clock_.monotonicNs();
  io::OnboardInput input;
  for (int i = 0; i < kMostInputsACycle && sequencer_.next(input); ++i) give(input);
  const std::int64_t now = clock_.utcNs();
  if (++cycles_ >= kTickEvery) {
    cycles_ = 0;
    give(sequencer_.own(now, io::Tick{}));
  }
  giveMarks();
  const std::int64_t given = clock_.monotonicNs();
  stages_.add(0, begin, given);
  publish(now);
  stages_.add(1, given, clock_.monotonicNs());
}

void HardTier::giveMarks() noexcept {
  io::Mark mark;
  while (marks_.pop(mark)) {
    give(sequencer_.own(clock_.utcNs(), mark));
    if (mark.kind == io::Mark::Kind::kEnd) ended_.store(true, std::memory_order_release);
  }
}

void HardTier::give(const io::OnboardInput& input) noexcept {
  ++inputs_;
  follow(input);
  // What the log misses it says itself (RecordingGap); what a mapper is too slow for it reads there.
  if (links_.recorder != nullptr) (void)links_.recorder->offerInput(input);
  links_.inputs->push(input);
}

void HardTier::follow(const io::OnboardInput& input) noexcept {
  if (const auto* sample = std::get_if<SensorSample>(&input.what)) nav_.add(*sample, input.arrival_utc_ns);
  // Nobody asks this copy for its pairs; they must not fill its queue.
  while (nav_.core().pollTrigger()) {
  }
  if (input.arrival_utc_ns - last_health_ns_ < kHealthInterval) return;
  last_health_ns_ = input.arrival_utc_ns;
  nav_.tick(input.arrival_utc_ns);
}

void HardTier::publish(std::int64_t now_ns) noexcept {
  const nav::DeadReckoning& odometry = nav_.core().odometry();
  NavState state;
  state.utc_ns = now_ns;
  state.inputs = inputs_;
  state.health = nav_.core().health();
  if (const auto pose = odometry.poseAt(odometry.newestUtcNs())) {
    state.pose_utc_ns = odometry.newestUtcNs();
    state.T_odom_body = *pose;
    state.velocity_body = odometry.velocityBody();
    state.altitude = odometry.altitude();
  }
  for_bus_.write(state);
  for_supervisor_.write(state);
}

}  // namespace fathom::onboard
