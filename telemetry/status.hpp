#pragma once

#include <cstdint>
#include <limits>
#include <span>

#include "telemetry/field.hpp"
#include "telemetry/frame.hpp"

namespace fathom::telemetry {

// Bits of Status::health. A set bit is something that the people on the ship should know.
enum HealthFlag : std::uint16_t {
  kHealthSoftRealTime = 1U << 0,  // runs without SCHED_FIFO or locked memory
  kHealthDvlLost = 1U << 1,       // no valid bottom track
  kHealthCompassLost = 1U << 2,
  kHealthDepthLost = 1U << 3,
  kHealthCameraLost = 1U << 4,      // no stereo pairs arrive
  kHealthNoFix = 1U << 5,           // position rests on dead reckoning alone
  kHealthOverload = 1U << 6,        // work is being shed
  kHealthPoolFull = 1U << 7,        // some pool is full
  kHealthMapCoarsened = 1U << 8,    // map resolution was given up
  kHealthRecorderFailed = 1U << 9,  // the mission is not being recorded whole
  kHealthDiskLow = 1U << 10,
  kHealthStereoPoor = 1U << 11,  // pairs arrive but give few points (turbid, dark, too high)
  kHealthSensorLies = 1U << 12,  // DVL or compass contradict the images
};
inline constexpr unsigned kHealthBits = 13;
[[nodiscard]] const char* healthText(unsigned bit);  // short text of bit 0 to kHealthBits - 1

inline constexpr double kAbsent = std::numeric_limits<double>::quiet_NaN();

// The vehicle's state. Values outside a field's bounds saturate; kAbsent where marked.
struct Status {
  // navigation half
  std::int64_t utc_ns = 0;          // of the pose, sent to 0.1 s
  double north = 0, east = 0;       // nav [m]
  double depth = 0;                 // nav z [m]
  double roll = 0, pitch = 0;       // [rad]
  double heading = 0;               // true [rad]
  double altitude = kAbsent;        // above the seafloor [m], or absent
  double speed = 0;                 // over ground [m/s]
  double position_sigma = kAbsent;  // standard deviation, horizontal, one axis [m], or absent
  // health half
  std::uint32_t pairs_seen = 0, pairs_used = 0, pairs_dropped = 0;
  std::uint32_t map_tiles = 0;
  double map_area = 0;                // seafloor covered [m2]
  double mission_progress = kAbsent;  // 0 to 1, or absent without a plan
  std::uint16_t health = 0;           // HealthFlag
  std::uint32_t slipped_cycles = 0;   // hard loop cycles that began late
  std::uint32_t shed_work = 0;        // frames or jobs given up by the soft tier for lack of time
  std::uint32_t pool_refusals = 0;    // requests that a full pool refused or coarsened away
};

namespace schema {
inline constexpr Field kTime{0, 429496729.5, 0.1};           // seconds since kTimeEpoch, 13 years
inline constexpr std::int64_t kTimeEpoch_s = 1735689600;     // 2025-01-01 UTC: saves four bits against 1970
inline constexpr Field kHorizontal{-52428.7, 52428.7, 0.1};  // [m]
inline constexpr Field kDepth{-50, 6500, 0.05};              // [m]
inline constexpr Field kRoll{-180, 180, 1};                  // [deg]
inline constexpr Field kPitch{-90, 90, 1};                   // [deg]
inline constexpr Field kHeading{0, 359.5, 0.5};              // [deg]
inline constexpr Field kAltitude{0, 102.2, 0.1, true};       // [m]
inline constexpr Field kSpeed{0, 6.35, 0.05};                // [m/s]
inline constexpr Field kPositionSigma{0, 102.3, 0.1, true};  // [m]
inline constexpr Field kPairs{0, 131071, 1};
inline constexpr Field kTiles{0, 16383, 1};
inline constexpr Field kArea{0, 131071, 1};  // [m2]
inline constexpr Field kProgress{0, 1, 0.01, true};
inline constexpr Field kHealth{0, (1 << kHealthBits) - 1, 1};
inline constexpr Field kCounter{0, 1023, 1};  // 1023: that many or more
}  // namespace schema

// Which part of a status a message carries.
enum class StatusPart : std::uint8_t { kWhole, kNavigation, kHealth };

// Payload sizes [B]; kWhole does not fit the smallest frames, the halves do.
[[nodiscard]] std::size_t statusBytes(StatusPart part);
// Returns the payload's size, 0 if `out` is too small.
[[nodiscard]] std::size_t encodeStatus(const Status& status, StatusPart part, std::span<std::uint8_t> out);
// Fills the part of `status` that the payload carries; false (status untouched) if it is not valid.
[[nodiscard]] bool decodeStatus(std::span<const std::uint8_t> payload, StatusPart part, Status& status);
// Whether every value is inside its field's bounds, so that nothing would saturate.
[[nodiscard]] bool validate(const Status& status);

// Time as the link carries it: 0.1 s, saturating outside the field.
[[nodiscard]] std::uint64_t timeToLink(std::int64_t utc_ns);
[[nodiscard]] std::int64_t timeFromLink(std::uint64_t code);

}  // namespace fathom::telemetry
