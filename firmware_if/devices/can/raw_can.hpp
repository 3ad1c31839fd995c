#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware_if/devices/can/can_frame.hpp"

namespace fathom::io {

// Frames as the log keeps them (channel RAW_CAN): records one behind the other, each
//
//   byte  what
//   0     u32, little endian: bits 0 to 28 the identifier (of an error frame: the error classes),
//         bit 29 set for an error frame
//   4     u24, little endian: how long before the entry's time of arrival the frame came [us], at most 16.7 s
//   7     u8: number of data bytes, 0 to 8
//   8     the data
struct RawCanRecord {
  CanFrame frame;  // utc_ns to 1 us
  bool error = false;
};

// Collects frames for one log entry. Allocates nothing.
class RawCanWriter {
 public:
  static constexpr std::size_t kMaxRecord = 16;  // [bytes]
  static constexpr std::size_t kFrames = 64;

  // False when it is full: empty it first. `frame` must have a time.
  [[nodiscard]] bool add(const CanFrame& frame, bool error) noexcept;
  // The entry, valid until the next call, to be logged with `arrivalNs()`; empty when no frame was added.
  [[nodiscard]] std::span<const std::uint8_t> bytes() noexcept;
  [[nodiscard]] std::int64_t arrivalNs() const noexcept { return arrival_ns_; }
  void clear() noexcept { count_ = 0; }

 private:
  std::array<RawCanRecord, kFrames> records_{};
  std::size_t count_ = 0;
  std::int64_t arrival_ns_ = 0;  // of the newest frame
  std::array<std::uint8_t, kFrames * kMaxRecord> bytes_{};
};

// Takes the first record off `bytes`. False at the end, and for damaged bytes: then some are left.
[[nodiscard]] bool readRawCan(std::span<const std::uint8_t>& bytes, std::int64_t arrival_utc_ns,
                              RawCanRecord& out) noexcept;

}  // namespace fathom::io
