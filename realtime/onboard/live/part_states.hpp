#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

namespace fathom::onboard {

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

}  // namespace fathom::onboard
