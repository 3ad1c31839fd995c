#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/recorder/byte_ring.hpp"

namespace fathom::io {

// Raw bytes and encoded messages of one producer that wait for the log.
class RawLane {
 public:
  enum class Kind : std::uint8_t { kRaw, kMessage };
  struct Entry {
    Kind kind = Kind::kRaw;
    std::int64_t arrival_utc_ns = 0;
    std::string_view channel;
    std::span<const std::uint8_t> data;
  };

  explicit RawLane(std::size_t bytes) : ring_(bytes) {}

  // Producer only; wait-free.
  [[nodiscard]] bool offer(const Entry& entry) noexcept {
    const std::string_view channel = entry.channel.substr(0, kMaxChannelBytes);
    const Head head{entry.arrival_utc_ns, entry.kind, static_cast<std::uint8_t>(channel.size())};
    return ring_.push({{reinterpret_cast<const std::uint8_t*>(&head), sizeof head},
                       {reinterpret_cast<const std::uint8_t*>(channel.data()), channel.size()},
                       entry.data});
  }
  // Consumer only: the oldest, into the lane's memory until pop(); false when there is none.
  [[nodiscard]] bool front(Entry& entry) noexcept {
    const std::span<const std::uint8_t> record = ring_.front();
    if (record.empty()) return false;
    Head head;
    std::memcpy(&head, record.data(), sizeof head);
    entry.kind = head.kind;
    entry.arrival_utc_ns = head.arrival_utc_ns;
    entry.channel = {reinterpret_cast<const char*>(record.data()) + sizeof head, head.channel_bytes};
    entry.data = record.subspan(sizeof head + head.channel_bytes);
    return true;
  }
  void pop() noexcept { ring_.pop(); }

  [[nodiscard]] std::uint64_t refused() const noexcept { return ring_.refused(); }

 private:
  struct Head {
    std::int64_t arrival_utc_ns = 0;
    Kind kind = Kind::kRaw;
    std::uint8_t channel_bytes = 0;
  };
  ByteRing ring_;
};

}  // namespace fathom::io
