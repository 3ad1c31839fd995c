#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "realtime/onboard/mission_run.hpp"
#include "realtime/onboard/onboard_config.hpp"

namespace fathom::onboard {

// A replay that reproduces the program's restarts: at the mark of each checkpoint that a restart used, it
// saves the state; at the mark of that restart it loads the state into a new run, restores the slots to that
// mark, and consumes again what was logged after it. Several restarts may use one checkpoint.
class RestartingRun {
 public:
  using Make = std::function<std::unique_ptr<MissionRun>()>;
  // The inputs must outlive it.
  RestartingRun(Make make, const std::vector<io::OnboardInput>& inputs);

  // Consumes the next input; false when there is none.
  bool step();
  [[nodiscard]] MissionRun& run() { return *run_; }

 private:
  struct Saved {
    std::size_t last_use = 0;  // the last restart that needs it
    std::size_t next = 0;      // input behind its mark
    std::vector<std::uint8_t> state;
  };
  void save(Saved& to, std::size_t next);
  void restart(std::uint64_t number);
  void restartEmpty();
  void consume(std::size_t i);
  void forgetSlots();

  Make make_;
  const std::vector<io::OnboardInput>& inputs_;
  std::unique_ptr<MissionRun> run_;
  std::map<std::uint64_t, Saved> saved_;  // by number; 0: before the first input
  std::size_t next_ = 0;
};

struct ReplayOptions {
  std::filesystem::path mission;
  std::optional<std::filesystem::path> config;  // TOML; absent: defaults
  std::optional<std::filesystem::path> out;     // absent: <mission>/onboard
  bool no_slam = false;                         // whatever the configuration says
  FrameExchangeOptions link;                    // the modem, in both directions
  double drain_s = 0;  // sending continues after the last sample until all is sent, at most so long [s]
};

struct ReplaySummary : RunSummary {
  std::uint64_t damaged_entries = 0;
  double wall_s = 0;  // of the replay
};

// Feeds a recorded (or simulated) mission to the three cores in logged order and writes onboard/. Everything
// but timing.json depends only on the mission, the configuration and the received frames (downlink.bin): two
// replays give identical bytes. Throws InputError for an unusable mission; an unreadable image is counted and
// its pair dropped.
ReplaySummary replay(const ReplayOptions& options);
// One line for the operator.
[[nodiscard]] std::string describe(const ReplaySummary& summary);

}  // namespace fathom::onboard
