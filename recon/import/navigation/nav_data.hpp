#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::topside {

// A quantity at one time.
struct NavRow {
  std::int64_t utc_ns = 0;
  Eigen::Vector3d value = Eigen::Vector3d::Zero();
};

// What files of navigation say: any of these, each at its own times.
struct NavData {
  std::vector<NavRow> position;  // latitude, longitude [rad], standard deviation [m] (0: not said)
  std::vector<NavRow> local;     // the same as north, east [m] of a place that nobody named
  std::vector<NavRow> depth;     // of the vehicle's reference point [m]
  std::vector<NavRow> heading;   // from true north [rad]
  std::vector<NavRow> tilt;      // roll, pitch [rad]
  std::vector<NavRow> altitude;  // over the seafloor [m]
  std::vector<NavRow> velocity;  // over ground: forward, starboard, down [m/s]
  std::vector<NavRow> track;     // over ground: north, east, down [m/s]
  std::vector<std::string> assumed;

  [[nodiscard]] bool empty() const;
};

struct NavFileOptions {
  std::vector<std::filesystem::path> files = {};  // CSV or NMEA 0183, recognised by their content
  std::string columns = {};                       // readNavCsv()
  std::string crs = {};                           // of eastings and northings, as EPSG:32755
  double declination = 0;                         // of magnetic headings, east positive [rad]
  double offset = 0;                              // added to its times to get the images' [s]
  double sigma = 1;                               // of positions that do not say [m]
};

// All files' rows, by time. `about_utc_ns`: when the images were taken, for times without a date. Throws
// InputError for a file that is absent, holds no navigation, or whose rows are damaged.
[[nodiscard]] NavData readNavFiles(const NavFileOptions& options, std::optional<std::int64_t> about_utc_ns);

// What is known of the vehicle where it took one pair.
struct KnownPose {
  std::optional<Eigen::Vector2d> north_east;  // in nav [m]
  double sigma = 0;                           // standard deviation of either [m]
  std::optional<double> depth;                // [m]
  std::optional<double> heading;              // [rad]
  std::optional<Eigen::Vector2d> tilt;        // roll, pitch [rad]
  std::optional<double> altitude;             // [m]
  std::optional<Eigen::Vector3d> moved;       // in nav, since the pair before, by velocities [m]

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.north_east, self.sigma, self.depth, self.heading, self.tilt, self.altitude, self.moved);
  }
};

// Nav's origin of a dive there: to a hundredth of a degree.
[[nodiscard]] Geodetic originNear(const Geodetic& place);
// That of the first position; none without.
[[nodiscard]] std::optional<Geodetic> originOf(const NavData& data);

// At the given times (ascending), on the line between the rows around; none where these are far apart.
[[nodiscard]] std::vector<KnownPose> knownAt(const NavData& data, const Geodetic& origin,
                                             const std::vector<std::int64_t>& times);

}  // namespace fathom::topside
