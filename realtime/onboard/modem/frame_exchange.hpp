#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <vector>

#include "realtime/kernel/frame_port.hpp"
#include "realtime/onboard/onboard_output.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::onboard {

struct FrameExchangeOptions {
  FramePort* modem = nullptr;
  // Gives a simulated modem the mission's time before each use; a real one needs none.
  std::function<void(std::int64_t now_ns)> modem_clock;
  // A downlink.bin: frames to receive instead of the modem's, at the times at which they were received.
  std::optional<std::filesystem::path> downlink;
  double speed = 0;  // mission seconds a second, with a modem; 0: as fast as the machine goes
};

// Exchanges frames between the onboard system and the modem in mission time. Frames sent are written into
// packets.bin, frames received into downlink.bin, link frame by link frame, in the order in which the system
// consumed them. Frames are received once at each time, after its first sample: the same frames at the same
// times replay exactly.
class FrameExchange {
 public:
  // Throws InputError for a downlink file that cannot be read, is damaged or runs backwards.
  FrameExchange(OnboardOutput& output, const FrameExchangeOptions& options);

  // A link frame that the modem received earlier and that is part of the other inputs.
  void receive(OnboardSystem& system, std::int64_t now_ns, std::span<const std::uint8_t> frame);
  // Mission time is `now_ns`: waits for that moment if the speed is given, then receives and sends.
  void exchange(OnboardSystem& system, std::int64_t now_ns, bool survey_over);

  struct Counters {
    std::uint64_t sent = 0, sent_bytes = 0;
    std::uint64_t refused = 0;  // by the modem
    std::uint64_t received = 0;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  void setCounters(const Counters& counters) { counters_ = counters; }  // of saved state

 private:
  using Clock = std::chrono::steady_clock;
  void pace(std::int64_t now_ns) const;
  void receiveAll(OnboardSystem& system, std::int64_t now_ns);

  OnboardOutput& output_;
  FrameExchangeOptions options_;
  std::int64_t first_ns_ = 0;  // mission time at start_
  Clock::time_point start_;
  std::optional<std::int64_t> received_at_ns_;
  std::vector<telemetry::Packet> recorded_;  // of options_.downlink
  std::size_t next_recorded_ = 0;
  std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer_{};
  Counters counters_;
};

}  // namespace fathom::onboard
