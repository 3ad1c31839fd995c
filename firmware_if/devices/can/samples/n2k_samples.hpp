#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "firmware_if/devices/can/n2k_decoder.hpp"
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

// The one address on the bus from which a quantity is taken: the configured one, or the first to send it. A
// device that was not configured may lose its address or die: after `switch_after_ns` of silence the next
// address that sends takes over.
class SourceSelection {
 public:
  SourceSelection() = default;
  SourceSelection(std::optional<std::uint8_t> configured, std::int64_t switch_after_ns) noexcept
      : source_(configured), configured_(configured.has_value()), switch_after_ns_(switch_after_ns) {}

  [[nodiscard]] bool accepts(std::uint8_t source, std::int64_t utc_ns) noexcept {
    if (!configured_ && source_ != source) {
      if (source_ && utc_ns - last_ns_ < switch_after_ns_) return false;
      changes_ += source_ ? 1 : 0;
      source_ = source;
    }
    if (source_ != source) return false;
    last_ns_ = utc_ns;
    return true;
  }

  [[nodiscard]] bool is(std::uint8_t source) const noexcept { return source_ == source; }
  [[nodiscard]] std::uint64_t changes() const noexcept { return changes_; }

 private:
  std::optional<std::uint8_t> source_;
  bool configured_ = false;
  std::int64_t switch_after_ns_ = 0;
  std::int64_t last_ns_ = 0;
  std::uint64_t changes_ = 0;
};

// A number that later messages need, and when it came.
struct HeldNumber {
  double value = 0;
  std::int64_t utc_ns = 0;
};

// Decoded NMEA 2000 messages in, device samples out. A message without a value that its sample must have
// gives no sample and is counted; other missing values stay absent. Sans I/O; allocates nothing.
//
//   127250, 127257  AttitudeSample (AttitudePairing). Heading = reading + deviation, where that is sent; true
//                   only if the message says so, or if `message_variation` and it sends the variation
//   127251          GyroSample: the rate of heading, to starboard positive
//   130314          DepthSample from the pressure of source "water" (recon/geometry/sea_water.hpp)
//   128267          DepthSample from one of its fields, where the configuration says which
//   127508, 127506  BatterySample: voltage and current (sent into the battery, given out of it); state of
//   charge 129029, 129025  GpsFix of a receiver that has a fix: sigma = HDOP times `gps_range_sigma_m`;
//   positions
//                   between fixes take the newest HDOP, at most kHdopHolds_s old. Estimated, manual and
//                   simulated positions are no fixes
//   130312, 130316, WaterSample of source "sea"; sound speed when salinity (130321, or configured) and depth
//   130321          are known
class N2kSamples {
 public:
  enum class DepthFrom : std::uint8_t {
    kPressure,  // 130314
    kDepth,     // 128267's depth field, from vehicles that put their own depth there
    kOffset,    // 128267's offset field: the transducer below the water line, as the standard has it
  };

  struct Config {
    // Addresses that samples are taken from; absent: the first to send.
    std::optional<std::uint8_t> heading_source, attitude_source, gyro_source, depth_source, battery_source,
        gps_source, water_source;
    double switch_after_s = 10;  // silence after which a source that is not configured is replaced
    double attitude_gap_s = 0.25;
    bool message_variation = false;
    DepthFrom depth_from = DepthFrom::kPressure;
    double surface_pressure_pa = 101325;           // that the sensor shows in air: 0 for a gauge
    double latitude = 0;                           // of the mission [rad], for gravity
    std::optional<double> water_density;           // [kg/m3]; absent: the standard ocean
    std::optional<std::uint8_t> battery_instance;  // absent: the first received
    double gps_range_sigma_m = 5;
    std::optional<double> salinity_psu;  // where no 130321 comes

    // Throws std::invalid_argument.
    void validate() const;
  };

  struct Counts {
    std::uint64_t samples = 0;
    std::uint64_t other_sources = 0;  // messages of addresses that are not selected
    std::uint64_t incomplete = 0;     // messages without what their sample must have
    std::uint64_t unpaired_headings = 0;
    std::uint64_t source_changes = 0;
  };

  static constexpr std::int64_t kHdopHolds_s = 3;     // 129029 comes once a second
  static constexpr std::int64_t kChargeHolds_s = 10;  // 127506 comes every 1.5 s
  static constexpr std::int64_t kWaterHolds_s = 60;   // depth and salinity, for the speed of sound

  explicit N2kSamples(const Config& config);

  // The samples that a message makes or completes, valid until the next call; none for one without a time.
  [[nodiscard]] std::span<const SensorSample> add(const N2kMessage& message) noexcept;
  [[nodiscard]] Counts counts() const noexcept;

 private:
  void give(const SensorSample& sample) noexcept { out_[out_count_++] = sample; }
  void incomplete() noexcept { ++counts_.incomplete; }
  void addHeading(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addTilt(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addTurn(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addPressure(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addWaterDepth(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addDepth(double depth, std::int64_t utc_ns) noexcept;
  void addBattery(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addCharge(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addGnss(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addPosition(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  void addWater(const N2kMessage& message, std::int64_t utc_ns) noexcept;
  [[nodiscard]] bool accepted(SourceSelection& source, const N2kMessage& message,
                              std::int64_t utc_ns) noexcept;
  [[nodiscard]] bool isOurBattery(const N2kMessage& message) noexcept;

  Config config_;
  SourceSelection heading_, tilt_, gyro_, depth_, battery_, gps_, water_;
  AttitudePairing pairing_;
  std::optional<double> battery_instance_;
  std::optional<HeldNumber> charge_, hdop_, salinity_, last_depth_;
  std::optional<std::int64_t> last_battery_ns_;
  std::array<SensorSample, AttitudePairing::kWaiting + 1> out_{};
  std::size_t out_count_ = 0;
  Counts counts_;
};

}  // namespace fathom::io
