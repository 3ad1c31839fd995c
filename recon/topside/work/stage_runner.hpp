#pragma once

#include <functional>
#include <string>
#include <vector>

#include "recon/topside/work/run_progress.hpp"
#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

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
