#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "telemetry/ship/ship_link.hpp"
#include "tests/onboard/kill/killed_dive.hpp"

namespace fathom::test {

// The ship above the vehicle: receives its frames and answers when it is its turn. It outlives the program.
class Ship {
 public:
  Ship() : link_(std::nullopt, std::nullopt) {}
  void talk(int socket);
  [[nodiscard]] const telemetry::LinkReceiver::Counters& counters() const {
    return link_.receiver().counters();
  }

 private:
  telemetry::ShipLink link_;
};

// One life of the program, and its own reports.
struct DiveLife {
  std::int64_t spawned_ns = 0, armed_ns = 0, navigates_ns = 0, caught_up_ns = 0;  // monotonic; 0: did not
  std::int64_t navigates_utc_ns = 0;                                              // by the vehicle's clock
  std::int64_t ended_ns = 0, ended_utc_ns = 0;  // when it was killed, by the vehicle's clock too
  std::optional<std::size_t> first;             // input of the mission that it was given
  bool resumed = false;
  double said_away_s = 0;
  std::optional<std::uint64_t> from;  // checkpoint that the mapper began with
  std::vector<DiveState> states;
  pid_t mapper = 0;                  // that followed last; 0: none yet
  std::int64_t follows_ns = 0;       // since then the mapper follows, monotonic
  std::optional<DiveMemory> memory;  // the last that was said
  std::vector<std::string> said;

  // A line that it wrote (killed_dive.hpp).
  void take(const std::string& line);
};

class DiveProcess {
 public:
  // Starts this same program again as the dive. Throws std::system_error.
  DiveProcess(const DiveOrders& orders, Ship& ship);
  ~DiveProcess();
  DiveProcess(const DiveProcess&) = delete;
  DiveProcess& operator=(const DiveProcess&) = delete;

  // Listens to it and plays the ship until `enough` says so or it has ended: whether it still runs.
  bool listen(const std::function<bool(const DiveLife&, std::int64_t mono_ns)>& enough);
  // Ends it by that signal, and reads what it still says: its exit status, or -1 when a signal ended it.
  int end(int signal, std::int64_t utc_offset_ns);
  [[nodiscard]] const DiveLife& life() const { return life_; }
  // Kills its mapper; false where it has none.
  bool killMapper();

 private:
  bool readLines(int timeout_ms);

  Ship& ship_;
  DiveLife life_;
  pid_t pid_ = -1;
  int out_ = -1, socket_ = -1;
  std::string half_;  // of a line
};

}  // namespace fathom::test
