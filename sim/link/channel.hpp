#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "realtime/kernel/frame_port.hpp"

namespace fathom::sim {

struct ChannelConfig {
  double loss = 0.1;  // fraction of lost frames
  // Mean length of the runs of losses (Gilbert-Elliott: a two-state Markov chain, one step for each frame,
  // that loses every frame in its bad state and none in its good one); 0: independent losses.
  double mean_burst = 0;
  double duplicate = 0.01;        // probability that a frame arrives twice
  double reorder = 0.02;          // probability that later frames overtake it
  double late_s = 0;              // its delay is uniform up to this; 0: always 1.5 times delay_s
  double corrupt = 0.01;          // probability that it arrives with damaged bytes
  double delay_s = 0.5;           // from the end of its transmission to its arrival
  double rate_bps = 0;            // of the modem; 0: no limit, and no preamble
  double preamble_s = 0;          // of each frame, before its bits
  std::size_t queue_frames = 64;  // that may wait for transmission; further ones are refused
  std::uint64_t seed = 1;
};

// Throws std::invalid_argument that names the member and its range.
void validate(const ChannelConfig& config);

// One direction of a simulated acoustic channel, in the caller's time, without sockets and clocks. The same
// seed and calls give the same result.
class AcousticChannel {
 public:
  struct Counters {
    std::uint64_t offered = 0, refused = 0, lost = 0, duplicated = 0, reordered = 0, corrupted = 0,
                  delivered = 0;
    std::uint64_t collided = 0;  // arrived while the receiver's own modem was transmitting
  };

  // Combined with a seed, gives the downlink a stream of its own.
  static constexpr std::uint64_t kDownlinkStream = 0x9E3779B97F4A7C15ULL;

  explicit AcousticChannel(const ChannelConfig& config);

  // Takes a frame of 1 to FramePort::kMaxFrameBytes bytes at `now_s`; false when its queue is full or the
  // size is out of range. Time must not run backwards.
  [[nodiscard]] bool send(double now_s, std::span<const std::uint8_t> frame);
  // Copies the next frame that has arrived by `now_s` into `buffer` (at least kMaxFrameBytes); its size, 0
  // for none.
  [[nodiscard]] std::size_t receive(double now_s, std::span<std::uint8_t> buffer);
  // Arrival time of the next frame in transit [s]; negative when there is none.
  [[nodiscard]] double nextArrival() const;
  // Half duplex: frames that arrive while the receiver's own modem transmits into `reverse` are lost.
  // `reverse` must outlive this channel.
  void loseWhileTransmitting(const AcousticChannel& reverse) { reverse_ = &reverse; }
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  struct InTransit {
    double begin_s = 0, arrival_s = 0;  // of its first and its last bit at the receiver
    std::uint64_t order = 0;            // breaks ties: first sent, first delivered
    std::vector<std::uint8_t> bytes;
  };
  struct Transmission {
    double begin_s = 0, end_s = 0;
  };
  void launch(double begin_s, double arrival_s, std::vector<std::uint8_t> bytes);
  [[nodiscard]] bool loses();
  [[nodiscard]] bool transmitting(double from_s, double to_s) const;

  ChannelConfig config_;
  std::mt19937_64 random_;
  std::vector<InTransit> in_transit_;
  std::vector<double> departures_;          // ends of the unfinished transmissions
  std::deque<Transmission> transmissions_;  // the last kTransmissions, for collisions at this end
  static constexpr std::size_t kTransmissions = 1024;
  const AcousticChannel* reverse_ = nullptr;
  bool bad_ = false;  // Gilbert-Elliott's state
  double busy_until_s_ = 0;
  std::uint64_t next_order_ = 0;
  Counters counters_;
};

// Both directions of a channel, as two ports; advance() sets the time.
class ChannelPair {
 public:
  // If the seeds are equal, `down` has a stream of its own. `half_duplex`: an end receives nothing while it
  // transmits; without a rate, frames take no time and never collide.
  ChannelPair(const ChannelConfig& up, const ChannelConfig& down, bool half_duplex = false);
  ChannelPair(const ChannelPair&) = delete;
  ChannelPair& operator=(const ChannelPair&) = delete;
  [[nodiscard]] FramePort& vehicle() { return vehicle_; }
  [[nodiscard]] FramePort& ship() { return ship_; }
  void advance(double now_s) { now_s_ = std::max(now_s_, now_s); }
  [[nodiscard]] const AcousticChannel& uplink() const { return up_; }
  [[nodiscard]] const AcousticChannel& downlink() const { return down_; }

 private:
  // One end: sends into one channel, receives from the other.
  class End final : public FramePort {
   public:
    End(const double& now_s, AcousticChannel& out, AcousticChannel& in) : now_s_(now_s), out_(out), in_(in) {}
    bool send(std::span<const std::uint8_t> frame) noexcept override { return out_.send(now_s_, frame); }
    std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
      return in_.receive(now_s_, buffer);
    }
    [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return 0; }

   private:
    const double& now_s_;
    AcousticChannel &out_, &in_;
  };
  double now_s_ = 0;
  AcousticChannel up_, down_;
  End vehicle_, ship_;
};

struct ChannelRelayOptions {
  std::uint16_t listen_port = 0;  // vehicle's frames arrive here (UDP, loopback and every other interface)
  std::string to_host;
  std::uint16_t to_port = 0;
  double idle_exit_s = 0;    // ends after this long without a frame; 0: only on SIGINT or SIGTERM
  ChannelConfig channel;     // from the vehicle to the ship
  ChannelConfig down;        // from the ship to the vehicle
  bool half_duplex = false;  // a modem receives nothing while it transmits
};

// Relays UDP datagrams (a datagram is a frame) from listen_port to to_host:to_port through a simulated
// acoustic channel, and datagrams that come back from there to the last sender, through a second one. Prints
// the counters on stderr at the end. Throws InputError for an address or port that cannot be used. Returns
// the exit code.
int runChannelRelay(const ChannelRelayOptions& options);

}  // namespace fathom::sim
