#include "recon/topside/work/stage_runner.hpp"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_pipeline.h>
#include <oneapi/tbb/task_arena.h>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>

#include "realtime/base/text.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace {

constexpr double kFirstShare = 0.02;  // of the run's work before a time is foretold

}  // namespace

std::string durationText(double seconds) {
  const long whole = std::lround(seconds);
  if (whole >= 3600) return formatted("%ld h %02ld min", whole / 3600, whole / 60 % 60);
  if (whole >= 60) return formatted("%ld min %02ld s", whole / 60, whole % 60);
  return formatted("%ld s", whole);
}

RunProgress::RunProgress(double total_weight) : total_(std::max(total_weight, 1e-9)) {}

void RunProgress::begin(std::string stage, std::size_t steps, double weight) {
  const std::lock_guard lock(mutex_);
  stage_ = std::move(stage);
  steps_ = std::max<std::size_t>(steps, 1);
  done_ = 0;
  stage_weight_ = weight;
}

void RunProgress::step(bool was_there) {
  const std::lock_guard lock(mutex_);
  done_ = std::min(done_ + 1, steps_);
  if (was_there) spared_ += stage_weight_ / static_cast<double>(steps_);
  bar_.show(doneWeight() / total_,
            stage_ + ": " + std::to_string(done_) + " of " + std::to_string(steps_) + timeLeft());
}

void RunProgress::end() {
  const std::lock_guard lock(mutex_);
  before_ += stage_weight_;
  stage_weight_ = 0;
  done_ = steps_;
}

double RunProgress::doneWeight() const {
  return before_ + stage_weight_ * static_cast<double>(done_) / static_cast<double>(steps_);
}

std::string RunProgress::timeLeft() const {
  const double done = doneWeight();
  const double made = done - spared_;
  if (made < kFirstShare * total_) return {};
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count();
  return ", " + durationText(elapsed / made * std::max(total_ - done, 0.0)) + " left";
}

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
