#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// NMEA 2000 sends heading (127250) and roll and pitch (127257) apart; navigation wants them of one instant.
//
// Messages of one device that carry the same sequence identifier (SID) are of one instant: they make a sample
// at the time of the earlier one. The SID of a device that never changes it is not used. Otherwise a heading
// waits for the first roll and pitch after it, and takes values interpolated between those before and after
// it; where these are further apart than `max_gap_ns`, or fail to come, the heading is dropped and counted.
// Samples leave in order of time. Allocates nothing.
class AttitudePairing {
 public:
  static constexpr std::size_t kWaiting = 8;  // headings that wait for one roll and pitch

  struct Heading {
    std::int64_t utc_ns = 0;
    std::uint8_t source = 0;
    std::optional<std::uint8_t> sid;
    double heading = 0;  // [rad]
    bool magnetic = true;
  };
  struct Tilt {
    std::int64_t utc_ns = 0;
    std::uint8_t source = 0;
    std::optional<std::uint8_t> sid;
    double roll = 0, pitch = 0;  // [rad]
  };

  explicit AttitudePairing(std::int64_t max_gap_ns = 250'000'000) noexcept : max_gap_ns_(max_gap_ns) {}

  // The samples that the message completes; valid until the next call.
  [[nodiscard]] std::span<const AttitudeSample> add(const Heading& heading) noexcept;
  [[nodiscard]] std::span<const AttitudeSample> add(const Tilt& tilt) noexcept;

  [[nodiscard]] std::uint64_t unpaired() const noexcept { return unpaired_; }  // headings dropped

 private:
  void give(const Heading& heading, std::int64_t utc_ns, double roll, double pitch) noexcept;
  [[nodiscard]] bool sameInstant(const Heading& heading, const Tilt& tilt) const noexcept;

  std::int64_t max_gap_ns_;
  std::array<Heading, kWaiting> waiting_{};
  std::size_t waiting_count_ = 0;
  std::optional<Tilt> tilt_;  // the newest
  bool tilt_sid_moves_ = false, heading_sid_moves_ = false;
  std::optional<std::uint8_t> last_heading_sid_;
  std::array<AttitudeSample, kWaiting + 1> out_{};
  std::size_t out_count_ = 0;
  std::optional<std::int64_t> last_given_ns_;
  std::uint64_t unpaired_ = 0;
};

}  // namespace fathom::io
