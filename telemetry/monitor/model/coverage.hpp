#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "telemetry/monitor/map/block_store.hpp"

namespace fathom::monitor {

struct TrackRecord {
  double north = 0, east = 0, depth = 0;  // nav [m]
  double altitude = 0;                    // above the seafloor [m]; NaN: not told
};
using Track = std::map<std::int64_t, TrackRecord>;  // by UTC [ns]

// Squares of 1 m that the cameras have passed over and of which nothing has been received. An estimate from
// what the link told: a band about the track as wide as the cameras see, tan(42 deg / 2) of the altitude to
// either side. Where two track points lie further apart than kMaxGap_s, only the ground below each counts.
struct PendingSquare {
  std::int32_t north = 0, east = 0;  // of its south-west corner [m]
  float depth = 0;                   // of the seafloor there, from the vehicle's depth and altitude [m]
};
struct Coverage {
  std::vector<PendingSquare> pending;  // by place
  double received_area = 0;            // squares of which something was received [m2]
  double changed_area = 0;             // of blocks that gave way to other content in the last kRecent_s [m2]
  std::int64_t changes_until_utc_ns = INT64_MAX;  // when that gets less, if nothing comes
};
inline constexpr double kViewAngle_deg = 42;  // across track, of the stereo cameras
inline constexpr double kMaxGap_s = 60;
inline constexpr double kRecent_s = 600;
inline constexpr double kDefaultAltitude_m = 2;  // until the first status
inline constexpr double kMaxAltitude_m = 10;     // higher, the cameras see nothing that maps

[[nodiscard]] Coverage coverageOf(const Track& track, const BlockStore& store, std::int64_t now_utc_ns);

}  // namespace fathom::monitor
