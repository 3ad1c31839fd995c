#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include "recon/geometry/geodesy.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {

// Bits of Status::health: set for what the operators on the ship should know.
enum HealthFlag : std::uint16_t {
  kHealthSoftRealTime = 1U << 0,  // runs without SCHED_FIFO or locked memory
  kHealthDvlLost = 1U << 1,       // no valid bottom track
  kHealthCompassLost = 1U << 2,
  kHealthDepthLost = 1U << 3,
  kHealthCameraLost = 1U << 4,      // no stereo pairs arrive
  kHealthNoFix = 1U << 5,           // position rests on dead reckoning alone
  kHealthOverload = 1U << 6,        // work is being shed
  kHealthPoolFull = 1U << 7,        // a pool is full
  kHealthMapCoarsened = 1U << 8,    // map resolution was reduced
  kHealthRecorderFailed = 1U << 9,  // the mission is not being recorded whole
  kHealthDiskLow = 1U << 10,
  kHealthStereoPoor = 1U << 11,          // pairs arrive but give few points (turbid, dark, too high)
  kHealthSensorContradicted = 1U << 12,  // DVL, compass or the rig's calibration contradict the images
  kHealthClockUnsure = 1U << 13,         // the vehicle's time is not known to be UTC to within a second
  kHealthNoMap = 1U << 14,               // mapping has stopped; the map's figures are from before
};
inline constexpr unsigned kHealthBits = 15;
[[nodiscard]] const char* healthText(unsigned bit);  // short text of bit 0 to kHealthBits - 1

inline constexpr double kAbsent = std::numeric_limits<double>::quiet_NaN();

// The vehicle's state. Values outside a field's bounds saturate; kAbsent where marked. Vehicle and dive are
// in the frame's header.
struct Status {
  std::int64_t utc_ns = 0;            // of the pose, sent to 0.5 s
  double north = 0, east = 0;         // nav [m]
  double depth = 0;                   // nav z [m]
  double roll = 0, pitch = 0;         // [rad]
  double heading = 0;                 // true [rad]
  double altitude = kAbsent;          // above the seafloor [m], or absent
  double speed = 0;                   // over ground [m/s]
  double position_sigma = kAbsent;    // standard deviation, horizontal, one axis [m], or absent
  double battery = kAbsent;           // charge left, 0 to 1, or absent
  std::uint32_t pairs_seen = 0;       // stereo pairs taken
  std::uint32_t pairs_dropped = 0;    // of these, those that added nothing to the map
  double map_area = 0;                // seafloor covered [m2]
  double mission_progress = kAbsent;  // 0 to 1, or absent without a plan
  std::uint16_t health = 0;           // HealthFlag
  std::uint32_t late_cycles = 0;      // hard loop cycles that began late
  std::uint32_t shed_work = 0;        // frames or jobs dropped by the soft tier for lack of time
  std::uint32_t pool_refusals = 0;    // requests that a full pool refused or coarsened away
};

namespace schema {
inline constexpr Field kTime{0, 429496729.5, 0.1};           // seconds since kTimeEpoch, 13 years
inline constexpr std::int64_t kTimeEpoch_s = 1735689600;     // 2025-01-01 UTC: saves four bits against 1970
inline constexpr Field kHorizontal{-52428.7, 52428.7, 0.1};  // of the track [m]
inline constexpr Field kDepth{-50, 6500, 0.05};              // of the track [m]
// The status: 22 bytes, so that it fits the smallest frame.
inline constexpr Field kStatusTime{0, 536870911.5, 0.5};           // seconds since kTimeEpoch, 17 years
inline constexpr Field kStatusHorizontal{-26214.2, 26214.2, 0.2};  // [m]
inline constexpr Field kStatusDepth{-50, 6500, 0.1};               // [m]
inline constexpr Field kTilt{-30, 30, 2};                          // roll and pitch [deg]
inline constexpr Field kHeading{0, 358.5, 1.5};                    // [deg]
inline constexpr Field kAltitude{0, 25.4, 0.1, true};              // [m]
inline constexpr Field kSpeed{0, 3.1, 0.1};                        // [m/s]
inline constexpr LogField kPositionSigma{0.05, 500, 6, true};      // steps of 17 % [m]
inline constexpr Field kBattery{0, 1, 0.02, true};
inline constexpr Field kProgress{0, 1, 0.02, true};
inline constexpr unsigned kHealthWidth = 15;        // room for flags to come
inline constexpr LogField kArea{1, 131072, 8};      // steps of 5 % [m2]
inline constexpr LogField kPairs{1, 131072, 7};     // steps of 10 %
inline constexpr LogField kDropped{1, 32768, 5};    // of pairs; steps of 42 %
inline constexpr LogField kLateCycles{1, 1000, 3};  // factors of 3.2
inline constexpr LogField kShed{1, 1000, 3};
inline constexpr LogField kRefusals{1, 8192, 4};  // factors of 2
}  // namespace schema

inline constexpr std::size_t kStatusBytes = 22;

// Returns the payload's size, 0 if `out` is too small.
[[nodiscard]] std::size_t encodeStatus(const Status& status, std::span<std::uint8_t> out);
// False (status untouched) if the payload is not valid.
[[nodiscard]] bool decodeStatus(std::span<const std::uint8_t> payload, Status& status);

// Outcome of a request that the vehicle has received.
struct RequestOutcome {
  enum class State : std::uint8_t { kNone, kTaken, kDone, kRefused };
  State state = State::kNone;   // kNone: no request
  std::uint8_t id = 0;          // as in Request
  DownlinkCounter counter = 0;  // of the frame that brought it; only the kOutcomeCounterBits lowest travel
  friend bool operator==(const RequestOutcome&, const RequestOutcome&) = default;
};
inline constexpr unsigned kOutcomeCounterBits = 10;

// The outcomes of the ship's requests, and the vehicle's health: sent at once when one of them changes, and
// again until the ship has it.
struct StateReport {
  std::uint16_t health = 0;  // HealthFlag, as in Status
  bool paused = false;       // sends no map, on request
  double rate_bps = 0;       // of sending, to 10 bit/s [bit/s]
  // The last ones received, newest first; requests taken and not yet done are kept.
  std::array<RequestOutcome, 6> requests{};
  friend bool operator==(const StateReport&, const StateReport&) = default;
};
inline constexpr std::size_t kStateReportBytes = 16;

// Returns the payload's size, 0 if `out` is too small.
[[nodiscard]] std::size_t encodeStateReport(const StateReport& report, std::span<std::uint8_t> out);
// False (report untouched) if the payload is not valid.
[[nodiscard]] bool decodeStateReport(std::span<const std::uint8_t> payload, StateReport& report);

// Time as the link carries it: 0.1 s, saturating outside the field.
[[nodiscard]] std::uint64_t timeToLink(std::int64_t utc_ns);
[[nodiscard]] std::int64_t timeFromLink(std::uint64_t code);

struct TrackPoint {
  std::int64_t utc_ns = 0;
  double north = 0, east = 0, depth = 0;  // nav [m]
};

// The last points of the track, newest first in the payload: the newest in full, each older one as
// differences of the quantised values (so a point decodes to the same numbers from every message that carries
// it). One width serves all differences of a message. Each point travels in several messages, so that a lost
// frame leaves no gap.
inline constexpr std::size_t kMaxTrackPoints = 63;

// Encodes the newest of `points` (oldest first, times rising) that fit; returns the payload's size, 0 for
// none.
[[nodiscard]] std::size_t encodeTrack(std::span<const TrackPoint> points, std::span<std::uint8_t> out);
// Writes the points oldest first into `out` (room for kMaxTrackPoints) and returns how many; 0 if not valid.
[[nodiscard]] std::size_t decodeTrack(std::span<const std::uint8_t> payload, std::span<TrackPoint> out);

// What a receiver needs to place the map on the Earth; sent seldom, and repeatedly.
struct MissionInfo {
  std::string vehicle_name;  // printable ASCII; as much of it as fits a frame is sent, at most kMaxNameBytes
  Geodetic origin;           // of nav [rad], sent to 1e-7 deg (1.1 cm)
  std::int64_t start_utc_ns = 0;  // sent to 0.1 s
  std::uint16_t schema_hash = 0;  // set by decodeMissionInfo: the sender's; compare with schemaHash()
};
inline constexpr std::size_t kMaxNameBytes = 31;

// Hash of every field's bounds and resolution in this protocol version.
[[nodiscard]] std::uint16_t schemaHash();

[[nodiscard]] std::size_t encodeMissionInfo(const MissionInfo& info, std::span<std::uint8_t> out);
[[nodiscard]] bool decodeMissionInfo(std::span<const std::uint8_t> payload, MissionInfo& info);

}  // namespace fathom::telemetry
