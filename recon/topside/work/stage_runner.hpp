#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "realtime/base/progress.hpp"
#include "recon/topside/work/stage_store.hpp"

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

// One result of a stage and how it is made: `make` writes the blocks and returns what it has cost.
struct StageTask {
  std::string item;
  Digest key;
  std::function<Costs(WorkFileWriter&)> make;
};

// What became of a stage.
struct StageOutcome {
  std::size_t there = 0, made = 0;
  double seconds = 0;  // wall clock
};

// Calls `work` with 0, 1, ... count - 1 in this order, at most `at_once` of them at a time, by oneTBB's
// threads.
void inOrder(std::size_t count, std::size_t at_once, const std::function<void(std::size_t)>& work);
[[nodiscard]] std::size_t threadsAllowed();

// Makes those results of a stage that are not in the store, at most `at_once` at a time. A task's own
// parallel work never takes up another task meanwhile, so no more tasks than that are in memory.
[[nodiscard]] StageOutcome runStage(StageStore& store, const std::string& stage,
                                    const std::vector<StageTask>& tasks, std::size_t at_once,
                                    RunProgress& progress, double weight);

}  // namespace fathom::topside
