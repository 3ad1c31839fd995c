#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "realtime/onboard/mission_run.hpp"

namespace fathom::onboard {

// A replay that starts again where the program did: at a checkpoint's mark the state is kept, at a restart's
// mark the one that the program came back with is loaded into a new run, and what was logged behind it is
// consumed again.
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
    std::uint64_t number = 0;
    std::size_t next = 0;  // input behind its mark
    std::vector<std::uint8_t> state;
  };
  void save(Saved& to, std::uint64_t number, std::size_t next);
  void restart(std::uint64_t number);

  Make make_;
  const std::vector<io::OnboardInput>& inputs_;
  std::unique_ptr<MissionRun> run_;
  bool restarts_ = false;        // the log has a restart: states are worth keeping
  Saved begin_;                  // before the first input
  std::array<Saved, 2> newest_;  // a program keeps two
  std::size_t next_ = 0;
};

}  // namespace fathom::onboard
