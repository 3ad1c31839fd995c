#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "realtime/kernel/memory/heap_counter.hpp"
#include "realtime/kernel/threads/realtime_config.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/onboard/live/devices/input_sequencer.hpp"
#include "realtime/onboard/nav/nav_feed.hpp"
#include "tests/support/latency_histogram.hpp"

namespace fathom::bench {

// The hard tier as it runs on the vehicle: a device thread pushes samples of compass, depth, DVL and cameras
// into a ring at their real rates, and the loop drains it into a NavCore.
class HardLoop {
 public:
  struct Result {
    test::LatencyHistogram latency;
    rt::ThreadCost cost;  // of the loop's thread, from its first cycle to its last
    std::uint64_t cycles = 0, late_cycles = 0, samples = 0;
    std::int64_t max_body_ns = 0;
  };

  explicit HardLoop(const rt::RealtimeConfig& config);

  // Runs both threads for some time. What the system refused is in refused().
  [[nodiscard]] Result run(std::int64_t duration_ns);
  [[nodiscard]] const std::vector<std::string>& refused() const { return loop_.refused(); }

 private:
  void feed();
  void loop(std::int64_t until_ns, Result& result);

  rt::RealtimeConfig config_;
  std::unique_ptr<onboard::NavFeed> nav_;
  onboard::InputRing ring_;
  std::atomic<bool> stop_{false};
  rt::RtThread device_, loop_;
};

}  // namespace fathom::bench
