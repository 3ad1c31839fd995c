#pragma once

#include <atomic>
#include <thread>
#include <vector>

namespace fathom::sim {

// Threads of ordinary priority that compute and never sleep.
class CpuHog {
 public:
  CpuHog() = default;
  ~CpuHog() { stop(); }
  CpuHog(const CpuHog&) = delete;
  CpuHog& operator=(const CpuHog&) = delete;

  void start(int threads) {
    stop_ = false;
    for (int i = 0; i < threads; ++i)
      threads_.emplace_back([this] {
        while (!stop_.load(std::memory_order_relaxed)) continue;
      });
  }
  void stop() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }

 private:
  std::atomic<bool> stop_{false};
  std::vector<std::thread> threads_;
};

}  // namespace fathom::sim
