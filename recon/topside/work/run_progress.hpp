#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

namespace fathom::topside {

// Progress over a whole run on stderr, with the time left: a bar on a terminal, a line each twentieth
// elsewhere. Stages have weights, their expected shares of the run's time; work that was done by an earlier
// run counts as done, not as speed. Thread-safe.
class RunProgress {
 public:
  explicit RunProgress(double total_weight);
  ~RunProgress();
  RunProgress(const RunProgress&) = delete;
  RunProgress& operator=(const RunProgress&) = delete;

  // The stage that begins, of so many steps that together have this weight.
  void begin(std::string stage, std::size_t steps, double weight);
  void step(bool was_there = false);
  void end();  // the stage's rest is done

 private:
  void show();
  [[nodiscard]] std::string timeLeft() const;

  std::mutex mutex_;
  std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
  double total_ = 0, before_ = 0, stage_weight_ = 0, spared_ = 0;  // spared: of work that was there
  std::size_t steps_ = 0, done_ = 0;
  int shown_ = 0;
  std::string stage_;
  bool terminal_;
};

}  // namespace fathom::topside
