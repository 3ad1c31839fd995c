#pragma once

#include <sys/types.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "realtime/onboard/mapper/mapper_channel.hpp"

namespace fathom::onboard {

// The mapper process: starts it without a copy of this process' pages (posix_spawn), detects its end, kills
// it. Used by one thread.
class MapperChild {
 public:
  struct Start {
    std::filesystem::path program;
    std::vector<std::string> arguments;
    // Become its files kMapperDownFile and on. Nothing else that this process has open is handed on.
    std::array<int, 4> files{};
  };
  explicit MapperChild(Start start);
  // Kills it.
  ~MapperChild();
  MapperChild(const MapperChild&) = delete;
  MapperChild& operator=(const MapperChild&) = delete;

  // "", or why it could not be started.
  [[nodiscard]] std::string start();
  [[nodiscard]] bool running() const { return pid_ > 0; }
  [[nodiscard]] pid_t pid() const { return pid_; }
  // Processor time of all its threads so far; 0 if it does not run.
  [[nodiscard]] std::int64_t cpuNs() const;
  // How it ended, once: "exit status 1", "signal 11 (Segmentation fault)". Does not wait.
  [[nodiscard]] std::optional<std::string> ended();
  // With SIGKILL; ended() reports it afterwards.
  void kill();

 private:
  Start start_;
  pid_t pid_ = -1;
};

// Decides about the mapper process: when to kill it, when and how to start it again. A plain state machine;
// the caller has the process.
//
// It is killed when it makes no progress: no beat for `stuck_after` while it follows the log, for
// `start_within` while it makes its pools and loads, and neither beat nor processor time for as long while it
// finishes. It is started again at once if it had progressed further than any mapper before it, else after a
// wait that doubles up to `longest_wait`. The cause of its death is kept from the next: a state that it was
// loading is avoided, a pair that two in a row were mapping is dropped. After `futile_starts` without
// progress it begins at the present with an empty map.
class MapperKeeper {
 public:
  struct Config {
    std::int64_t stuck_after_ns = 2'000'000'000;
    std::int64_t start_within_ns = 30'000'000'000;
    std::int64_t first_wait_ns = 100'000'000, longest_wait_ns = 30'000'000'000;
    int futile_starts = 6;
  };
  // Observation of the process and of its last figures.
  struct Seen {
    std::int64_t now_ns = 0;  // monotonic
    bool running = false;
    MapperPhase phase = MapperPhase::kStarting;
    std::uint64_t beats = 0, position = 0;
    std::int64_t cpu_ns = 0;         // that the process has worked
    std::uint64_t loading = 0;       // checkpoint; 0: none
    std::uint64_t working_pair = 0;  // + 1; 0: none
  };
  struct Orders {
    bool kill = false, start = false;
    bool lost = false;        // it ended, and not because all was done
    bool from_empty = false;  // of a start
    std::optional<std::uint64_t> avoid;
    std::optional<std::uint32_t> drop_pair;
    std::string why;  // of a kill
  };

  explicit MapperKeeper(const Config& config) : config_(config) {}

  // Call some times a second. After orders to start, the caller starts it before the next call; if it does
  // not run then, it has died.
  [[nodiscard]] Orders step(const Seen& seen);
  // The map is written, or there is none.
  [[nodiscard]] bool done() const { return done_; }
  [[nodiscard]] std::uint64_t starts() const { return starts_; }

 private:
  void learnFrom(const Seen& seen, Orders& orders);

  Config config_;
  bool was_running_ = false, done_ = false, killed_ = false;
  std::int64_t last_life_ns_ = 0, next_start_ns_ = 0, cpu_ns_ = 0;
  MapperPhase phase_ = MapperPhase::kStarting;
  std::uint64_t beats_ = 0, furthest_ = 0, starts_ = 0;
  std::uint64_t died_on_pair_ = 0;
  int futile_ = 0;
};

}  // namespace fathom::onboard
