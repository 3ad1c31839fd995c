#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <random>
#include <span>
#include <vector>

#include "realtime/kernel/frame_port.hpp"

namespace fathom::sim {

struct ChannelConfig {
  double loss = 0.1;  // share of the frames that never arrive
  // Losses come in runs of this mean length (Gilbert-Elliott: a two-state Markov chain, one step a frame,
  // that loses every frame in its bad state and none in its good one); 0: each frame by itself.
  double mean_burst = 0;
  double duplicate = 0.01;        // that it arrives twice
  double reorder = 0.02;          // that later frames overtake it
  double late_s = 0;              // by how much, evenly up to this; 0: always 1.5 times the delay
  double corrupt = 0.01;          // that it arrives with damaged bytes
  double delay_s = 0.5;           // from the end of its transmission to its arrival
  double rate_bps = 0;            // of the modem; 0: no limit, and no preamble
  double preamble_s = 0;          // that the modem needs before each frame's bits
  std::size_t queue_frames = 64;  // waiting for transmission; more are refused
  std::uint64_t seed = 1;
};

// Throws std::invalid_argument that names the member and its range.
void validate(const ChannelConfig& config);

// One direction of a simulated acoustic channel, in the caller's time: no sockets, no clocks. Same seed and
// the same calls, same outcome.
class AcousticChannel {
 public:
  struct Counters {
    std::uint64_t offered = 0, refused = 0, lost = 0, duplicated = 0, reordered = 0, corrupted = 0,
                  delivered = 0;
    std::uint64_t collided = 0;  // arrived while the receiver's own modem was speaking
  };

  explicit AcousticChannel(const ChannelConfig& config);

  // Takes a frame of 1 to FramePort::kMaxFrameBytes bytes at `now_s`; false when its queue is full or the
  // size is out of range. Time must not run backwards.
  [[nodiscard]] bool send(double now_s, std::span<const std::uint8_t> frame);
  // Copies the next frame that has arrived by `now_s` into `buffer` (at least kMaxFrameBytes); its size, 0
  // for none.
  [[nodiscard]] std::size_t receive(double now_s, std::span<std::uint8_t> buffer);
  // When the next frame on its way arrives [s]; negative when there is none.
  [[nodiscard]] double nextArrival() const;
  // Half duplex: what arrives while the receiver's own modem speaks into `reverse` (its channel, which must
  // outlive this one's use) is lost.
  void deafWhileSpeaking(const AcousticChannel& reverse) { reverse_ = &reverse; }
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  struct Flying {
    double begin_s = 0, arrival_s = 0;  // of its first and its last bit at the receiver
    std::uint64_t order = 0;            // breaks ties: first sent, first delivered
    std::vector<std::uint8_t> bytes;
  };
  struct Transmission {
    double begin_s = 0, end_s = 0;
  };
  void launch(double begin_s, double arrival_s, std::vector<std::uint8_t> bytes);
  [[nodiscard]] bool loses();
  [[nodiscard]] bool speaking(double from_s, double to_s) const;

  ChannelConfig config_;
  std::mt19937_64 random_;
  std::vector<Flying> flying_;
  std::vector<double> departures_;          // ends of the transmissions that are not over yet
  std::deque<Transmission> transmissions_;  // the last kTransmissions, for whoever is deaf meanwhile
  static constexpr std::size_t kTransmissions = 1024;
  const AcousticChannel* reverse_ = nullptr;
  bool bad_ = false;  // Gilbert-Elliott's state
  double busy_until_s_ = 0;
  std::uint64_t next_order_ = 0;
  Counters counters_;
};

// Both directions, as two ports joined by the channel; time is set by advance().
class ChannelPair {
 public:
  // `down` uses its own seed stream derived from up.seed when the seeds are equal. `half_duplex`: neither end
  // hears while it speaks; frames without a rate take no time, and collide with nothing.
  ChannelPair(const ChannelConfig& up, const ChannelConfig& down, bool half_duplex = false);
  ~ChannelPair();
  [[nodiscard]] FramePort& vehicle();
  [[nodiscard]] FramePort& ship();
  void advance(double now_s);
  [[nodiscard]] const AcousticChannel& uplink() const;
  [[nodiscard]] const AcousticChannel& downlink() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim
