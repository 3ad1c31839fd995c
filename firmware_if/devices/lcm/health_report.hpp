#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>

#include "firmware_if/devices/short_text.hpp"
#include "firmware_if/mission/log/log_messages.hpp"

namespace fathom::io {

// State of the program, for other programs and its own log. Plain values of fixed size: filling them takes no
// memory; encoding does, and is for a best-effort thread. Times are the vehicle's, UTC.
//
//   channel              type                    holds
//   FATHOM_POSE          fathom.pose_t           PoseReport
//   <vehicle>.ACFR_NAV   acfrlcm.auv_acfr_nav_t  the same for ACFR tools: degrees for latitude and longitude,
//                                                x north, y east, velocities in body; absent altitude 0
//   FATHOM_MAP           fathom.map_t            MapReport
//   FATHOM_LINK          fathom.link_t           LinkReport
//   FATHOM_HEALTH        fathom.health_t         HealthReport

// A named number that only ever grows: drops by cause, events.
struct NamedCount {
  ShortName name;
  std::uint64_t value = 0;
};

// The vehicle's best pose: T_nav_odom * T_odom_body.
struct PoseReport {
  std::int64_t utc_ns = 0;
  double latitude = 0, longitude = 0;                            // WGS84 [rad]
  Eigen::Vector3d position = Eigen::Vector3d::Zero();            // in nav: north, east, depth [m]
  Eigen::Quaterniond attitude = Eigen::Quaterniond::Identity();  // body in nav
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();            // of body, in body [m/s]
  Eigen::Vector3d rates = Eigen::Vector3d::Zero();               // about the body's axes [rad/s]
  std::optional<double> altitude;                                // [m]
  std::optional<double> sigma_horizontal;                        // of either component [m]
};

struct MapReport {
  std::int64_t utc_ns = 0;
  std::uint64_t pairs = 0;  // mapped so far
  std::uint64_t keyframes = 0;
  std::uint64_t closures = 0;  // loop closures accepted
  double area_m2 = 0;          // mapped
  double finest_cell_m = 0;    // of the map as it is now
  double coarsest_cell_m = 0;
  ShortList<NamedCount, 32> counts;  // pairs dropped, closures postponed, tiles coarsened...
};

struct LinkReport {
  std::int64_t utc_ns = 0;
  bool open = false;                  // the modem's port is there
  std::optional<double> heard_ago_s;  // since a good frame of the ship
  double rate_bps = 0;                // that is spent
  double share_on_ship = 0;           // of the map's blocks that the ship has, 0 to 1
  std::uint64_t frames_sent = 0, frames_received = 0, bytes_sent = 0, bytes_received = 0;
  ShortList<NamedCount, 32> counts;
};

struct StageReport {
  ShortName name;
  std::uint64_t runs = 0, deadline_misses = 0;
  double last_ms = 0, p50_ms = 0, p99_ms = 0, max_ms = 0;
};

// A queue or a pool: how full it is now, was at most, and can be; entries or bytes, as its name says.
struct FillReport {
  ShortName name;
  double used = 0, high_water = 0, capacity = 0;
  std::uint64_t refused = 0;
};

struct DeviceReport {
  ShortName name;
  bool open = false;
  std::optional<double> silent_s;  // since its last good data; absent: none yet
  std::uint64_t samples = 0, disconnects = 0;
};

// Where a part of the program is: "starting", "catching up", "running", "failed" (and why), "ended".
struct PartOfProgram {
  ShortName name, state;
  ShortText<63> reason;
};

struct HealthReport {
  std::int64_t utc_ns = 0;
  bool soft = false;              // runs without real-time privileges
  std::uint8_t degradation = 0;   // level of the overload rule, 0 none
  double uptime_s = 0;            // since the program was armed
  std::uint64_t restarts = 0;     // of the program in this mission
  std::uint64_t clock_steps = 0;  // of the system's clock, noticed
  double resident_mib = 0, budget_mib = 0;
  std::optional<double> disk_free_mib, temperature_c, load;
  ShortList<StageReport, 32> stages;
  ShortList<FillReport, 48> fills;
  ShortList<NamedCount, 96> drops;  // what was lost, by cause
  ShortList<DeviceReport, 16> devices;
  ShortList<PartOfProgram, 24> parts;
};

[[nodiscard]] LogMessage encodePose(const PoseReport& pose);
[[nodiscard]] LogMessage encodeAcfrNav(const PoseReport& pose, const std::string& vehicle_name);
[[nodiscard]] LogMessage encodeMap(const MapReport& map);
[[nodiscard]] LogMessage encodeLink(const LinkReport& link);
[[nodiscard]] LogMessage encodeHealth(const HealthReport& health);

}  // namespace fathom::io
