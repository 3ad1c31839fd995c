#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "recon/geometry/se3.hpp"

namespace fathom::onboard {

enum class FixKind : std::uint8_t { kGps, kUsbl };

// A position fix that has met the odometry of the time at which it was true.
struct PositionFix {
  FixKind kind = FixKind::kGps;
  std::int64_t utc_ns = 0;
  Eigen::Vector2d north_east = Eigen::Vector2d::Zero();  // of the sensor in nav [m]
  double sigma = 0;                                      // horizontal standard deviation [m]
  SE3 T_odom_sensor;                                     // pose of the antenna or transponder in odom
};

// T_nav_odom from position fixes: odom is North-East-Down with absolute depth, so what is missing is a
// horizontal shift. Collects the differences nav - odom of GPS fixes at the surface and of USBL fixes; GPS
// wins, USBL serves where there is none. The estimate is the weighted mean of the differences within three
// sigma of their component-wise median, so that wild fixes do not enter. Fixed memory: later fixes of a kind
// beyond the capacity are counted only.
class PositionAnchor {
 public:
  static constexpr int kCapacity = 256;  // fixes kept a kind

  void add(const PositionFix& fix) noexcept;
  // The shift as far as known; std::nullopt before the first fix.
  [[nodiscard]] std::optional<SE3> estimate() const noexcept;
  [[nodiscard]] double sigma() const noexcept;  // horizontal standard deviation of the estimate [m]; 0 before

  struct Counters {
    std::uint64_t gps = 0, usbl = 0, refused = 0;
  };
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

 private:
  struct Difference {
    Eigen::Vector2d north_east = Eigen::Vector2d::Zero();  // nav - odom [m]
    double sigma = 1;                                      // [m]
  };
  struct Series {
    std::array<Difference, kCapacity> items{};
    int size = 0;
  };
  struct Solution {
    Eigen::Vector2d north_east;
    double sigma;
  };

  [[nodiscard]] static std::optional<Solution> solve(const Series& series) noexcept;
  [[nodiscard]] std::optional<Solution> best() const noexcept;

  Series gps_, usbl_;
  Counters counters_;
};

}  // namespace fathom::onboard
