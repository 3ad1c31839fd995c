#pragma once

#include <cstdint>
#include <string>

namespace fathom::onboard {

// Whether the program can go on as it is: navigation and supervisor show signs of life. Where one of them
// does not, only another process can do their work. A state machine without threads.
class ProgramWatch {
 public:
  struct Config {
    std::int64_t navigation_ns = 2'000'000'000;  // that navigation may be silent for
    std::int64_t supervisor_ns = 5'000'000'000;  // the supervisor, which waits for the system
  };
  explicit ProgramWatch(const Config& config) : config_(config) {}

  // Some times a second, with counts that grow as long as the two live: why the program must end, "" where it
  // need not.
  [[nodiscard]] std::string look(std::int64_t now_ns, std::uint64_t navigation_beats,
                                 std::uint64_t supervisor_beats);
  // Navigation was alive when it was looked at last: what the service manager's own watchdog is told.
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

}  // namespace fathom::onboard
