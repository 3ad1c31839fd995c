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
#include "telemetry/packet_log.hpp"

namespace fathom::monitor {

// Where frames come from.
class FrameFeed {
 public:
  virtual ~FrameFeed() = default;
  // Gives the frames that have arrived by now to `take(bytes, utc_ns)`; returns how many.
  virtual std::size_t poll(const std::function<void(std::span<const std::uint8_t>, std::int64_t)>& take) = 0;
  [[nodiscard]] virtual bool recorded() const = 0;
  [[nodiscard]] virtual bool finished() const = 0;
};

// Frames from modem ports, stamped with the time at which they were read.
class LiveFeed final : public FrameFeed {
 public:
  explicit LiveFeed(std::vector<std::unique_ptr<FramePort>> ports) : ports_(std::move(ports)) {}
  std::size_t poll(const std::function<void(std::span<const std::uint8_t>, std::int64_t)>& take) override;
  [[nodiscard]] bool recorded() const override { return false; }
  [[nodiscard]] bool finished() const override { return false; }

 private:
  std::vector<std::unique_ptr<FramePort>> ports_;
};

// Frames of a packets.bin, `speed` times as fast as they were sent; 0: without waiting, kBatch a poll.
// A file that is damaged from some byte on gives what comes before it, then poll() throws InputError once.
class RecordedFeed final : public FrameFeed {
 public:
  RecordedFeed(const std::filesystem::path& packets, double speed) : reader_(packets), speed_(speed) {}
  std::size_t poll(const std::function<void(std::span<const std::uint8_t>, std::int64_t)>& take) override;
  [[nodiscard]] bool recorded() const override { return true; }
  [[nodiscard]] bool finished() const override { return finished_; }

 private:
  static constexpr std::size_t kBatch = 64;
  telemetry::PacketLogReader reader_;
  double speed_;
  std::optional<telemetry::Packet> next_;
  bool begun_ = false, finished_ = false;
  std::int64_t first_utc_ns_ = 0, begun_monotonic_ns_ = 0;
};

}  // namespace fathom::monitor
