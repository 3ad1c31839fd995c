#pragma once

#include <cstddef>
#include <mutex>
#include <string>
#include <utility>

namespace fathom::rt {

// Progress of some work on stderr: a bar that redraws itself on a terminal, elsewhere a line per twentieth.
class ProgressBar {
 public:
  ProgressBar();
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void show(double share, const std::string& text);  // 0 to 1
  void show(std::size_t done, std::size_t steps, const std::string& what);

 private:
  bool terminal_;
  int shown_ = 0;      // twentieths
  std::string drawn_;  // on the terminal
};

// Progress of one stage that has a known number of steps. Thread-safe.
class StageProgress {
 public:
  StageProgress(std::string stage, std::size_t steps) : stage_(std::move(stage)), steps_(steps) {}
  void step() {
    const std::lock_guard lock(mutex_);
    bar_.show(++done_, steps_, stage_);
  }

 private:
  std::mutex mutex_;
  ProgressBar bar_;
  std::string stage_;
  std::size_t steps_, done_ = 0;
};

}  // namespace fathom::rt
