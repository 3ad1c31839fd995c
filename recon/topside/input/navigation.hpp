#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/navigation/dead_reckoning/dead_reckoning.hpp"
#include "recon/navigation/dead_reckoning/position_anchor.hpp"
#include "recon/topside/config/topside_config.hpp"

namespace fathom::topside {

// Where odom's origin is in nav (north, east), and by which source. Rotation and depth are absolute already.
struct Anchor {
  std::string source = "none";  // "gps", "usbl", "gps and usbl", or "none": odom's origin is taken for nav's
  double north = 0, east = 0;   // [m]
  double sigma = 0;             // standard deviation of either [m]
  int fixes_used = 0, fixes_rejected = 0;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.source, self.north, self.east, self.sigma, self.fixes_used, self.fixes_rejected);
  }
};

struct NavigatedPose {
  std::int64_t utc_ns = 0;
  std::optional<SE3> T_nav_body;        // none: outside the recorded navigation
  std::optional<double> altitude;       // of the DVL, vertical [m]
  nav::DeadReckoning::Quality quality;  // of dead reckoning up to there

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.utc_ns, self.T_nav_body, self.altitude, self.quality);
  }
};

// A position fix and where dead reckoning, anchored, has the receiver. Its standard deviation is the fix's
// own with what the vehicle may have drifted without bottom track between it and the nearest of the times
// asked for (SensorNoise::unknown_velocity).
struct FixSeen {
  nav::FixKind kind = nav::FixKind::kGps;
  std::int64_t utc_ns = 0;
  Eigen::Vector2d north_east = Eigen::Vector2d::Zero();  // in nav [m]
  double sigma = 0;                                      // horizontal [m]
  Eigen::Vector3d receiver = Eigen::Vector3d::Zero();    // in nav [m]

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.enumeration(self.kind, nav::FixKind::kUsbl);
    archive(self.utc_ns, self.north_east, self.sigma, self.receiver);
  }
};

struct Navigation {
  std::vector<NavigatedPose> poses;  // as asked for
  std::vector<NavigatedPose> track;  // whole dive, one a second
  Anchor anchor;
  std::vector<FixSeen> fixes;  // GPS, one a minute once there are images, and USBL
  // Shift to nav by GPS before the dive alone, against the anchored poses, and its standard deviation with
  // what the vehicle may have drifted between the last fix and the first image; none without GPS [m].
  std::optional<Eigen::Vector2d> gps_shift;
  double gps_sigma = 0;
  nav::DeadReckoning::Counters counters;
  std::uint64_t skipped_entries = 0, damaged_entries = 0;  // of the log

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.poses, self.track, self.anchor, self.fixes, self.gps_shift, self.gps_sigma, self.counters,
            self.skipped_entries, self.damaged_entries);
  }
};

// Dead reckoning over the recorded sensors (time offsets and lever arms as mission.toml says), read out at
// the given times (ascending), depth less the tide that mission.toml foretells, and anchored in nav by the
// GPS fixes before the first of `times` (where there are none, by those of a vehicle that came up later) and
// all USBL fixes (nav::PositionAnchor). Roll, pitch and heading count as measured `attitude_late` seconds
// before their stamps, beside what mission.toml says; a gyro's rates do not. Throws InputError when the log
// holds no navigation.
[[nodiscard]] Navigation navigate(const io::MissionPaths& paths, const io::MissionConfig& mission,
                                  const TopsideConfig& config, const std::vector<std::int64_t>& times,
                                  double attitude_late = 0);

}  // namespace fathom::topside
