#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

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

}  // namespace fathom::onboard
