#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "realtime/kernel/threads/realtime_config.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/kernel/threads/watchdog.hpp"

namespace fathom::onboard {

// The threads of a live run, each with a heartbeat. A thread that has left is started again, one that hangs
// is reported. An exception ends its thread alone, which is restarted if restartable: at once, and at growing
// intervals if it leaves without a heartbeat. Everything but the bodies runs on one thread.
class WatchedThreads {
 public:
  using Body = std::function<void(rt::Heartbeat&)>;
  struct Watch {
    bool restartable = true;
    std::int64_t least_ns = 0;    // that it may be silent for, where the configuration says less
    bool waits_for_disk = false;  // may hang as long as the disk does
  };

  explicit WatchedThreads(const rt::RealtimeConfig& config) : config_(config) {}

  // Before start(). Returns the heartbeat that the body must beat.
  rt::Heartbeat& add(rt::Tier tier, const char* name, const Watch& watch, Body body);
  // The names of those that the system gave no thread; the watchdog tries them again like one that has left.
  [[nodiscard]] std::vector<std::string> start();
  void watchFrom(std::int64_t now_ns);
  // Some times a second; a line for each thing that happened.
  void look(std::int64_t now_ns, std::vector<std::string>& events);
  void unwatch();
  // Name of a thread that has been silent for as long as `patience_ns` gives for its limit and whose body has
  // not left; "" if there is none.
  [[nodiscard]] std::string hanging(const std::function<std::int64_t(std::int64_t)>& patience_ns) const;
  // Waits for every body to return while `more_time()`, at most as long as each may be silent unless it waits
  // for the disk; names of those that have not returned.
  [[nodiscard]] std::vector<std::string> join(const std::function<bool()>& more_time);

  // Exception that ended the body of this name last; "" if none ever did.
  [[nodiscard]] std::string reasonOf(std::string_view name) const;
  [[nodiscard]] const rt::Watchdog& watchdog() const { return watchdog_; }
  [[nodiscard]] std::size_t stackBytes() const;

 private:
  struct Worker {
    Worker(const rt::ThreadConfig& config, std::function<void()> work, std::size_t tier, const Watch& watch)
        : thread(config), body(std::move(work)), watched(tier), kind(watch), name(config.name) {}
    rt::RtThread thread;
    std::function<void()> body;
    std::size_t watched;  // tier of the watchdog
    Watch kind;
    std::string name;
    std::string reason;  // that it left for, before it was started again
    // Since its last start.
    std::uint64_t beats = 0;
    std::int64_t next_start_ns = 0;
    int left_in_a_row = 0;
  };
  static std::string left(Worker& worker);  // and why
  void startAgain(Worker& worker, std::int64_t now_ns, std::vector<std::string>& events);

  const rt::RealtimeConfig& config_;
  rt::Watchdog watchdog_;
  std::deque<Worker> workers_;
};

}  // namespace fathom::onboard
