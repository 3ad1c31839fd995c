#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "realtime/kernel/threads/realtime_config.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/kernel/threads/watchdog.hpp"

namespace fathom::onboard {

// Whether the program can continue: navigation and supervisor show signs of life. If one of them does not,
// only a new process can do its work. A state machine without threads.
class ProgramWatch {
 public:
  struct Config {
    std::int64_t navigation_ns = 2'000'000'000;  // that navigation may be silent for
    std::int64_t supervisor_ns = 5'000'000'000;  // the supervisor, which waits for the system
  };
  explicit ProgramWatch(const Config& config) : config_(config) {}

  // Call some times a second, with counts that grow while the two are alive. Returns why the program must
  // end, "" if it need not.
  [[nodiscard]] std::string look(std::int64_t now_ns, std::uint64_t navigation_beats,
                                 std::uint64_t supervisor_beats);
  // Navigation was alive at the last look: the condition for serving the service manager's watchdog.
  [[nodiscard]] bool alive() const { return alive_; }

 private:
  struct Life {
    std::uint64_t beats = 0;
    std::int64_t last_ns = 0;
    // For how long it has been silent.
    std::int64_t look(std::int64_t now_ns, std::uint64_t now_beats);
  };
  Config config_;
  Life navigation_, supervisor_;
  bool alive_ = false;
};

// Time to wait for a hung thread before the whole program is restarted, which costs navigation a second.
// Doubles with each such restart of a dive.
class HungRestarts {
 public:
  // Counted in a file of that folder.
  explicit HungRestarts(const std::filesystem::path& state_folder);
  // Wait for a thread that may be silent for `limit_ns`.
  [[nodiscard]] std::int64_t patienceNs(std::int64_t limit_ns) const;
  // Counts a restart. False if that could not be written: then the program must not end.
  [[nodiscard]] bool note();
  // A thread of this process waits for a disk that does not answer, so that the process could not end either.
  [[nodiscard]] static bool waitsForDisk();

 private:
  std::filesystem::path file_;
  int count_ = 0;
};

// State of a part of the program: navigation, recorder, each device, mapper, link, output, publisher.
enum class PartState : std::uint8_t { kStarting, kCatchingUp, kRunning, kFailed, kEnded };
[[nodiscard]] const char* nameOf(PartState state);

struct PartReport {
  std::string name;
  PartState state = PartState::kStarting;
  std::string reason;  // of kFailed, and of what keeps it from running
};

// Every part's state, written by the supervisor, read by any reporter; both in best-effort threads (a mutex).
class PartStates {
 public:
  // True when the part's state is another now.
  bool set(std::string_view name, PartState state, std::string reason = "");
  [[nodiscard]] std::vector<PartReport> read() const;
  [[nodiscard]] PartReport read(std::string_view name) const;  // kStarting where it is not known

 private:
  mutable std::mutex mutex_;
  std::vector<PartReport> parts_;
};

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
