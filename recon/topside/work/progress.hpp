#pragma once

#include <cstddef>
#include <mutex>
#include <string>

namespace fathom::topside {

// Progress of one stage on stderr: a bar on a terminal, a line each tenth elsewhere. Not thread-safe.
class Progress {
 public:
  Progress(std::string stage, std::size_t steps);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void step();

 private:
  void show() const;

  std::string stage_;
  std::size_t steps_, done_ = 0, shown_tenth_ = 0;
  bool terminal_;
};

// One that several threads advance.
class SharedProgress {
 public:
  SharedProgress(std::string stage, std::size_t steps) : progress_(std::move(stage), steps) {}
  void step() {
    const std::lock_guard lock(mutex_);
    progress_.step();
  }

 private:
  std::mutex mutex_;
  Progress progress_;
};

}  // namespace fathom::topside
