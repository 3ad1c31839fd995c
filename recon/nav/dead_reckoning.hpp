#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "recon/geometry/se3.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::nav {

struct DeadReckoningConfig {
  SE3 T_body_dvl, T_body_depth, T_body_compass;
  double magnetic_declination = 0;    // [rad], east positive
  double sound_speed = 1500.0;        // at the DVL until a water sample says better [m/s]
  double max_dvl_gap = 2.0;           // without bottom track longer than this the velocity decays to zero [s]
  double max_speed = 3.0;             // faster bottom-track velocities are rejected [m/s]
};

// Odometry from DVL, attitude and depth: T_odom_body. odom is North-East-Down with its origin above (on the surface)
// the point where dead reckoning began; depth is absolute. Smooth, never jumps; allocates nothing after construction.
class DeadReckoning {
 public:
  explicit DeadReckoning(const DeadReckoningConfig& config);

  void add(const DvlSample& sample) noexcept;
  void add(const AttitudeSample& sample) noexcept;
  void add(const DepthSample& sample) noexcept;
  void add(const WaterSample& sample) noexcept;

  // Needs attitude, depth and one bottom-track velocity.
  [[nodiscard]] bool initialised() const noexcept;
  // Pose at a time within the kept history (some seconds), interpolated; a little beyond the newest: extrapolated.
  [[nodiscard]] std::optional<SE3> poseAt(std::int64_t utc_ns) const noexcept;
  [[nodiscard]] std::int64_t newestUtcNs() const noexcept;
  // Altitude of the DVL above the bottom [m] at the newest valid ensemble not older than max_dvl_gap.
  [[nodiscard]] std::optional<double> altitude() const noexcept;
  [[nodiscard]] Eigen::Vector3d velocityBody() const noexcept;  // over ground [m/s]

  struct Counters {
    std::uint64_t dvl_used = 0, dvl_without_bottom = 0, dvl_rejected = 0, out_of_order = 0;
  };
  [[nodiscard]] const Counters& counters() const noexcept;

 private:
  // State, history ring of fixed capacity, latest attitude and depth: see dead_reckoning.cpp.
};

}  // namespace fathom::nav
