#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "telemetry/monitor/map/block_store.hpp"

namespace fathom::monitor {

struct TrackRecord {
  double north = 0, east = 0, depth = 0;  // nav [m]
  double altitude = 0;                    // above the seafloor [m]; NaN: unknown
};
using Track = std::map<std::int64_t, TrackRecord>;  // by UTC [ns]

// A square of 1 m that the cameras have passed over and of which nothing has been received. Estimated from
// the received track: a band as wide as the cameras' footprint, tan(42 deg / 2) of the altitude to either
// side. Between track points more than kMaxGap_s apart only the ground below each counts.
struct PendingSquare {
  std::int32_t north = 0, east = 0;  // of its south-west corner [m]
  float depth = 0;                   // of the seafloor there, from the vehicle's depth and altitude [m]
};
struct Coverage {
  std::vector<PendingSquare> pending;             // by place
  double received_area = 0;                       // squares with a received node [m2]
  double changed_area = 0;                        // of blocks that changed in the last kRecent_s [m2]
  std::int64_t changes_until_utc_ns = INT64_MAX;  // until when changed_area holds, if nothing comes
};
inline constexpr double kViewAngle_deg = 42;  // across track, of the stereo cameras
inline constexpr double kMaxGap_s = 60;
inline constexpr double kRecent_s = 600;
inline constexpr double kDefaultAltitude_m = 2;  // until the first status
inline constexpr double kMaxAltitude_m = 10;     // above it the cameras map nothing

[[nodiscard]] Coverage coverageOf(const Track& track, const BlockStore& store, std::int64_t now_utc_ns);

}  // namespace fathom::monitor
