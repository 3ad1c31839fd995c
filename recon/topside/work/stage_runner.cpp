#include "recon/topside/work/stage_runner.hpp"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_pipeline.h>
#include <oneapi/tbb/task_arena.h>

#include <atomic>

#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace tbb = oneapi::tbb;

std::size_t threadsAllowed() {
  return tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
}

void inOrder(std::size_t count, std::size_t at_once, const std::function<void(std::size_t)>& work) {
  std::size_t next = 0;
  tbb::parallel_pipeline(at_once,
                         tbb::make_filter<void, std::size_t>(tbb::filter_mode::serial_in_order,
                                                             [&](tbb::flow_control& flow) -> std::size_t {
                                                               if (next == count) {
                                                                 flow.stop();
                                                                 return 0;
                                                               }
                                                               return next++;
                                                             }) &
                             tbb::make_filter<std::size_t, void>(tbb::filter_mode::parallel, work));
}

StageOutcome runStage(StageStore& store, const std::string& stage, const std::vector<StageTask>& tasks,
                      std::size_t at_once, RunProgress& progress, double weight) {
  Stopwatch watch;
  progress.begin(stage, tasks.size(), weight);
  std::atomic<std::size_t> made = 0;
  inOrder(tasks.size(), at_once, [&](std::size_t k) {
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
  });
  progress.end();
  return {tasks.size() - made, made, watch.lap()};
}

}  // namespace fathom::topside
