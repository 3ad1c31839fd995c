#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <pthread.h>

namespace fathom::rt {

struct ThreadConfig {
  std::string name;                       // shown by top and in reports; Linux keeps 15 characters
  int fifo_priority = 0;                  // 1 to 99: SCHED_FIFO; 0: the system's fair scheduling with `nice`
  int nice = 0;                           // -20 to 19, of fair scheduling
  std::vector<int> cpus;                  // that it may run on; empty: those of the process
  std::size_t stack_bytes = 1024 * 1024;  // rounded up to pages; every page is touched before the body begins
};

// A thread with a pre-faulted stack and a guard page below it, so that its body never faults on the stack.
// Policy, priority and affinity are set before the body begins. Settings that the system refuses are listed
// and the thread runs without them: the code that arms decides whether that is acceptable.
//
// The stack is made once; start() after the body has returned reuses it.
class RtThread {
 public:
  // Throws std::system_error when there is no memory for the stack (set-up only).
  explicit RtThread(ThreadConfig config);
  // Joins; the body must have been asked to return.
  ~RtThread();
  RtThread(const RtThread&) = delete;
  RtThread& operator=(const RtThread&) = delete;

  // Returns when policy, affinity and name are set (or refused) and `body` is about to begin. False when a
  // body is still running or the system gives no thread. An exception that leaves the body ends it, never the
  // program, and is kept as failure().
  [[nodiscard]] bool start(std::function<void()> body);
  // Waits for the body to return; at once where none runs.
  void join() noexcept;

  [[nodiscard]] bool running() const noexcept { return running_.load(std::memory_order_acquire); }
  [[nodiscard]] const ThreadConfig& config() const noexcept { return config_; }
  [[nodiscard]] std::size_t stackBytes() const noexcept { return stack_bytes_; }  // without the guard page
  [[nodiscard]] std::uint64_t starts() const noexcept { return starts_; }
  // Of the last start: one line for each thing refused, as "SCHED_FIFO 80: Operation not permitted". For the
  // thread that calls start().
  [[nodiscard]] const std::vector<std::string>& refused() const noexcept { return refused_; }
  // Of the last body, once it no longer runs: the exception's text, or "".
  [[nodiscard]] const std::string& failure() const noexcept { return failure_; }

 private:
  static void* enter(void* self);
  template <class Work>
  void fenced(const Work& work) noexcept;
  void keepFailure(const char* why) noexcept;

  ThreadConfig config_;
  std::byte* mapping_ = nullptr;
  std::size_t mapping_bytes_ = 0, stack_bytes_ = 0;
  pthread_t thread_{};
  bool joinable_ = false;
  std::uint64_t starts_ = 0;
  std::function<void()> body_;
  std::vector<std::string> refused_;
  std::string failure_;
  std::atomic<bool> ready_{false}, running_{false};
};

// Applies policy, affinity and name to the calling thread, as for one that the program did not start (main).
// One line for each thing refused.
[[nodiscard]] std::vector<std::string> applyThreadConfig(const ThreadConfig& config);

// Between two looks of a thread that waits for what another one does.
inline constexpr std::int64_t kPollRest_ns = 2'000'000;
// The calling thread sleeps so long, by the machine's clock; less where a signal comes.
void restFor(std::int64_t ns) noexcept;

// Threads that libraries start get stacks of this size instead of 8 MiB, which locked memory would fill.
// Before any of them starts; false when the system refuses.
[[nodiscard]] bool setLibraryStackBytes(std::size_t bytes) noexcept;

}  // namespace fathom::rt
