#include "tests/bench/realtime/hard_loop.hpp"

#include <algorithm>
#include <stdexcept>

#include "realtime/kernel/time/periodic_loop.hpp"

namespace fathom::bench {
namespace {

constexpr std::int64_t kNsPerUs = 1000;
// Devices keep no step with the loop: their samples come at every phase of its cycle.
constexpr std::int64_t kSamplePeriodNs = 9'700'000;
// Rates of the sensors, as every n-th of some 100 samples a second.
constexpr int kDepthEvery = 10, kDvlEvery = 20, kFrameEvery = 50;

}  // namespace

HardLoop::HardLoop(const rt::RealtimeConfig& config)
    : config_(config),
      nav_(std::make_unique<onboard::NavFeed>(onboard::NavCoreConfig{})),
      device_(rt::threadConfig(config, rt::Tier::kDevice, "devices")),
      loop_(rt::threadConfig(config, rt::Tier::kHard, "navigation")) {}

void HardLoop::feed() {
  rt::RealClock clock;
  rt::PeriodicLoop periodic(clock, kSamplePeriodNs);
  std::uint32_t n = 0;
  periodic.run([&] {
    const std::int64_t utc = clock.utcNs();
    const auto push = [&](const SensorSample& sample) { (void)ring_.push({utc, sample}); };
    push(AttitudeSample{utc, 0.01, 0.02, 1.0, false});
    if (n % kDepthEvery == 0) push(DepthSample{utc, 20.0});
    if (n % kDvlEvery == 0) {
      DvlSample dvl;
      dvl.utc_ns = utc;
      dvl.velocity = Eigen::Vector3d(0.5, 0, 0);
      dvl.altitude = 2.0;
      push(dvl);
    }
    if (n % kFrameEvery == 0)
      for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight})
        push(ImageEvent{utc, side, {}, 0.002});
    ++n;
    return !stop_.load(std::memory_order_relaxed);
  });
}

void HardLoop::loop(std::int64_t until_ns, Result& result) {
  rt::RealClock clock;
  rt::PeriodicLoop periodic(clock, config_.period_ns);
  const rt::ThreadCost before = rt::threadCost();
  periodic.run([&] {
    const std::int64_t now = clock.monotonicNs();
    result.latency.add((now - periodic.nextDeadlineNs()) / kNsPerUs);
    io::OnboardInput input;
    while (ring_.pop(input)) {
      nav_->add(std::get<SensorSample>(input.what), input.arrival_utc_ns);
      ++result.samples;
    }
    while (nav_->core().pollTrigger()) {
    }
    return now < until_ns;
  });
  result.cost = rt::threadCost() - before;
  result.cycles = periodic.statistics().cycles;
  result.late_cycles = periodic.statistics().skipped_cycles;
  result.max_body_ns = periodic.statistics().max_body_ns;
}

HardLoop::Result HardLoop::run(std::int64_t duration_ns) {
  Result result;
  stop_ = false;
  if (!device_.start([this] { feed(); })) throw std::runtime_error("no thread for the devices");
  const std::int64_t until = rt::RealClock().monotonicNs() + duration_ns;
  if (!loop_.start([&] { loop(until, result); })) throw std::runtime_error("no thread for the loop");
  loop_.join();
  stop_ = true;
  device_.join();
  return result;
}

}  // namespace fathom::bench
