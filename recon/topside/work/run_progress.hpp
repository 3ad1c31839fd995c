#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

#include "realtime/base/progress.hpp"

namespace fathom::topside {

// "1 h 02 min", "3 min 07 s", "12 s".
[[nodiscard]] std::string durationText(double seconds);

// Progress over a whole run, with the time left. Stages have weights, their expected shares of the run's
// time; work that was done by an earlier run counts as done, not as speed. Thread-safe.
class RunProgress {
 public:
  explicit RunProgress(double total_weight);

  // The stage that begins, of so many steps that together have this weight.
  void begin(std::string stage, std::size_t steps, double weight);
  void step(bool was_there = false);
  void end();  // the stage's rest is done

 private:
  [[nodiscard]] double doneWeight() const;
  [[nodiscard]] std::string timeLeft() const;

  std::mutex mutex_;
  std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
  double total_, before_ = 0, stage_weight_ = 0, spared_ = 0;  // spared: of work that was there
  std::size_t steps_ = 1, done_ = 0;
  std::string stage_;
  rt::ProgressBar bar_;
};

}  // namespace fathom::topside
