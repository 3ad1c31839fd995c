#include "recon/topside/work/stage_runner.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <atomic>

#include "realtime/kernel/memory/process_memory.hpp"
#include "recon/topside/stage_times.hpp"

namespace fathom::topside {

StageOutcome runStage(StageStore& store, const std::string& stage, const std::vector<StageTask>& tasks,
                      RunProgress& progress, double weight) {
  namespace tbb = oneapi::tbb;
  Stopwatch watch;
  progress.begin(stage, tasks.size(), weight);
  std::atomic<std::size_t> made = 0;
  // One task at a time to a thread, in the order given.
  const tbb::blocked_range<std::size_t> all(0, tasks.size(), 1);
  tbb::parallel_for(
      all,
      [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t k = range.begin(); k != range.end(); ++k) {
          const StageTask& task = tasks[k];
          const bool there = store.find(stage, task.item, task.key).has_value();
          if (!there) {
            tbb::this_task_arena::isolate([&] {
              Stopwatch own;
              WorkFileWriter file = store.writer(stage, task.item, task.key);
              Costs costs = task.make(file);
              file.commit();
              costs["wall_s"] = own.lap();
              store.written(stage, task.item, task.key, costs);
            });
            ++made;
          }
          progress.step(there);
        }
      },
      tbb::simple_partitioner());
  progress.end();
  return {tasks.size() - made, made, watch.lap()};
}

}  // namespace fathom::topside
