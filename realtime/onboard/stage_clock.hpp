#pragma once

#include <chrono>
#include <map>
#include <string>

#include "realtime/base/numbers/log_histogram.hpp"

namespace fathom::onboard {

// Wall-clock times of the stages that a core reports, and of whole frames.
class StageClock {
 public:
  void begin() {
    last_ = Clock::now();
    any_ = false;
  }
  // Since begin() or the stage before.
  void ended(const char* stage) {
    const auto now = Clock::now();
    stages_[stage].add(std::chrono::duration_cast<std::chrono::nanoseconds>(now - last_).count());
    last_ = now;
    any_ = true;
  }
  // A sample that led to stages was a frame.
  void endSample(double seconds) {
    if (any_) stages_["frame"].add(static_cast<std::int64_t>(seconds * 1e9));
  }
  [[nodiscard]] const std::map<std::string, rt::LogHistogram>& stages() const { return stages_; }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point last_;
  bool any_ = false;
  std::map<std::string, rt::LogHistogram> stages_;  // [ns]
};

}  // namespace fathom::onboard
