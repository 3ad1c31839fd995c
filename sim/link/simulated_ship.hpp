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
  double loss = 0.1;                                        // share of the frames, either way
  double duplicate = 0.01, reorder = 0.02, corrupt = 0.01;  // as in ChannelConfig
  double mean_burst = 0;                                    // of runs of lost frames; 0: each by itself
  double delay_s = 1.0;                                     // of sound, one way
  double rate_bps = 300;                                    // of either modem
  double preamble_s = 0;                                    // of either modem, before each frame
  bool half_duplex = true;                                  // neither modem hears while it speaks
  std::uint64_t seed = 1;
  std::size_t frame_bytes = 32;  // of the downlink's frames
  std::optional<telemetry::LinkKey> key;
  // The ship's computer is off from the one to the other time, in seconds of the mission: it hears nothing,
  // says nothing and starts again with nothing in its memory.
  double off_from_s = 0, off_to_s = 0;
};

// A ship that listens and answers, in mission time: the simulated water (sim/link), the ship's end of the
// link (telemetry::ShipLink), and a file of the frames as the ship heard them, with their times, for
// fathom-monitor --packets.
class SimulatedShip {
 public:
  // Throws InputError for a file that cannot be made or a water that cannot be.
  SimulatedShip(const std::filesystem::path& heard, const SimulatedShipOptions& options);
  ~SimulatedShip();

  // The vehicle's modem.
  [[nodiscard]] FramePort& modem();
  // The ship has measured where the vehicle is: said in one of its next turns, one fix a turn, oldest first.
  // Those that wait too long to be said (163 s) are dropped by the sender.
  void addFix(const telemetry::UsblFixMessage& fix);
  // The mission has come to `now_ns`: what the ship has heard by then it has answered.
  void advance(std::int64_t now_ns);
  // The file appears whole.
  void finish();

  struct Summary {
    std::uint64_t sent = 0, heard = 0, collided = 0, repaired = 0;  // the vehicle's frames
    std::uint64_t answers = 0, answers_heard = 0;                   // the ship's
    std::uint64_t fixes_said = 0, fixes_waiting = 0;
    double loss = 0;  // share of the vehicle's frames
  };
  [[nodiscard]] Summary summary() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim
