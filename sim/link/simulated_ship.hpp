#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "realtime/kernel/frame_port.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/link_key.hpp"

namespace fathom::sim {

struct SimulatedShipOptions {
  double loss = 0.1;                                        // fraction of frames, in each direction
  double duplicate = 0.01, reorder = 0.02, corrupt = 0.01;  // as in ChannelConfig
  double mean_burst = 0;                                    // of runs of lost frames; 0: each by itself
  double delay_s = 1.0;                                     // of sound, in one direction
  double rate_bps = 300;                                    // of either modem
  double preamble_s = 0;                                    // of either modem, before each frame
  bool half_duplex = true;                                  // a modem receives nothing while it transmits
  std::uint64_t seed = 1;
  std::size_t frame_bytes = 32;  // of the downlink's frames
  std::optional<telemetry::LinkKey> key;
  // The ship's computer is off between these mission seconds: it receives and sends nothing, and restarts
  // with an empty state.
  double off_from_s = 0, off_to_s = 0;
};

// A ship that receives and answers in mission time: the simulated channel, the ship's end of the link
// (telemetry::ShipLink), and a file of the received frames with their times, for fathom-monitor --packets.
class SimulatedShip {
 public:
  // Throws InputError for a file that cannot be written and for channel options out of range.
  SimulatedShip(const std::filesystem::path& packet_file, const SimulatedShipOptions& options);
  ~SimulatedShip();

  // The vehicle's modem.
  [[nodiscard]] FramePort& modem();
  // Queues a position fix of the vehicle: one is sent in each turn, oldest first. The sender drops fixes
  // older than 163 s.
  void addFix(const telemetry::UsblFixMessage& fix);
  // Advances to `now_ns`: receives and answers the frames that arrive until then.
  void advance(std::int64_t now_ns);
  // Completes the file.
  void finish();

  struct Summary {
    std::uint64_t sent = 0, received = 0, collided = 0, repaired = 0;  // the vehicle's frames
    std::uint64_t answers = 0, answers_received = 0;                   // the ship's
    std::uint64_t fixes_sent = 0, fixes_waiting = 0;
    double loss = 0;  // share of the vehicle's frames
  };
  [[nodiscard]] Summary summary() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim
