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

// Makes those results of a stage that are not in the store, in parallel over oneTBB's threads; a task's own
// parallel work never takes up another task meanwhile, so no more tasks than threads are in memory.
[[nodiscard]] StageOutcome runStage(StageStore& store, const std::string& stage,
                                    const std::vector<StageTask>& tasks, RunProgress& progress,
                                    double weight);

}  // namespace fathom::topside
