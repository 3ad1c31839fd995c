#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "realtime/kernel/frame_port.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::monitor {

// Takes a modem frame; true: it held an accepted link frame.
using TakeFrame = std::function<bool(std::span<const std::uint8_t>, std::int64_t utc_ns)>;

// Modem frames from ports, stamped with the time at which they were read.
class LiveFeed {
 public:
  explicit LiveFeed(std::vector<std::unique_ptr<FramePort>> ports) : ports_(std::move(ports)) {}
  // Passes on the frames that have arrived, and reports the accepted ones to their port; returns the number
  // of frames.
  std::size_t poll(const TakeFrame& take);
  // Hands a frame to every port; true if one took it.
  bool send(std::span<const std::uint8_t> frame);

 private:
  std::vector<std::unique_ptr<FramePort>> ports_;
};

// A packets.bin, read into memory, as a recording that plays at any speed, pauses and seeks.
class Recording {
 public:
  // Of a damaged file it plays the part before the damage; damage() says so. Throws InputError if the file
  // cannot be read or holds no frame.
  explicit Recording(const std::filesystem::path& packets);

  [[nodiscard]] std::int64_t firstUtcNs() const { return packets_.front().utc_ns; }
  [[nodiscard]] std::int64_t lastUtcNs() const { return last_ns_; }
  [[nodiscard]] std::int64_t atUtcNs() const { return at_ns_; }
  [[nodiscard]] bool finished() const { return next_ == packets_.size(); }
  [[nodiscard]] bool playing() const { return playing_; }
  [[nodiscard]] double speed() const { return speed_; }
  [[nodiscard]] const std::string& damage() const { return damage_; }

  // Playing speed as a multiple of real time; 0: as fast as it can be taken.
  void setSpeed(double speed, std::int64_t monotonic_ns);
  void setPlaying(bool playing, std::int64_t monotonic_ns);
  // The next polls pass on everything up to this time without waiting. True: the time is earlier than the
  // present one, the frames start from the first again, and the caller drops what it has received.
  [[nodiscard]] bool seek(std::int64_t utc_ns, std::int64_t monotonic_ns);
  // Passes on the frames that are due, at most kBatch; returns their number.
  std::size_t poll(const TakeFrame& take, std::int64_t monotonic_ns);

 private:
  void anchor(std::int64_t monotonic_ns);

  static constexpr std::size_t kBatch = 128;  // so that the page is answered in between
  std::vector<telemetry::Packet> packets_;
  std::string damage_;
  std::size_t next_ = 0;
  std::int64_t last_ns_ = 0;  // the latest time of any frame
  std::int64_t at_ns_ = 0;    // playing time reached
  double speed_ = 0;
  bool playing_ = true;
  std::int64_t anchor_utc_ns_ = 0, anchor_monotonic_ns_ = 0;
};

}  // namespace fathom::monitor
