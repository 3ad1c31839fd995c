#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>

namespace fathom::nav {

enum class FixKind : std::uint8_t { kGps, kUsbl };

// Where odom's origin is in nav, from position fixes: odom is North-East-Down with absolute depth, so what is
// missing is a horizontal shift. Each fix gives one difference: its position in nav less the odometry's
// position of the antenna or transponder at the fix's time.
//
// Differences further than three robust standard deviations from the component-wise median of their kind do
// not enter (Rousseeuw & Leroy 1987). Those of a kind are averaged with weights 1 / sigma^2. USBL errors are
// independent from ping to ping but for what all share (the ship's place, the transceiver's mounting), so n
// fixes are worth n down to that; GPS errors last for minutes, so all fixes of a float are worth one. The two
// means are then combined with weights 1 / sigma^2.
//
// The shift is asked for at a moment of the track. What odometry did not measure between a fix and then,
// |unlocked_s - unlocked_s of the fix| seconds at an unknown velocity, adds to the fix's error:
//   sigma_i^2 = sigma^2 + (v |u - u_i|)^2.
// A fix with an error that is small against the drift that has grown since
// (three of its sigmas beyond the least drift of its kind) does not enter:
// those of a float before the launch would else be the median's majority.
//
// Fixed memory: of a kind, kCapacity differences are kept, spread evenly over all that came (every second is
// dropped when there is no more room, then only every second, fourth, ... is taken). Allocates nothing.
class PositionAnchor {
 public:
  static constexpr int kCapacity = 256;  // differences kept a kind

  // `usbl_shared`: standard deviation of what all USBL positions share, either component [m].
  explicit PositionAnchor(double usbl_shared) : usbl_shared_(usbl_shared) {}

  // `difference`: nav - odom, (north, east) [m]; `sigma`: of the fix, horizontal [m]; `unlocked_s`: of the
  // track at the fix (DeadReckoning::Quality), below zero by the time before the track began [s]. Not finite,
  // negative or kilometre-wide sigmas are refused and counted.
  void add(FixKind kind, const Eigen::Vector2d& difference, double sigma, double unlocked_s = 0) noexcept;

  struct Estimate {
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();  // nav - odom [m]
    double sigma = 0;                                 // standard deviation of either component [m]
    int gps_used = 0, usbl_used = 0, outliers = 0;    // differences
  };
  // Where the track has `unlocked_s`, at an unknown velocity of that standard deviation [m/s]. std::nullopt
  // before the first fix.
  [[nodiscard]] std::optional<Estimate> estimate(double unlocked_s = 0,
                                                 double unknown_velocity = 0) const noexcept;
  // By fixes of one kind alone; sigma without what all of the USBL share.
  [[nodiscard]] std::optional<Estimate> estimate(FixKind kind, double unlocked_s = 0,
                                                 double unknown_velocity = 0) const noexcept;

  struct Counters {
    std::uint64_t gps = 0, usbl = 0, refused = 0;
  };
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) { archive(self.gps_, self.usbl_, self.counters_); }

 private:
  struct Difference {
    Eigen::Vector2d north_east = Eigen::Vector2d::Zero();
    double sigma = 1;       // [m]
    double unlocked_s = 0;  // of the track [s]

    static void exchange(auto& archive, auto& self) { archive(self.north_east, self.sigma, self.unlocked_s); }
  };
  struct Series {
    std::array<Difference, kCapacity> items{};
    int size = 0;
    std::uint64_t seen = 0;    // sane differences offered
    std::uint64_t stride = 1;  // every stride-th is kept
    void add(const Difference& difference) noexcept;

    static void exchange(auto& archive, auto& self) {
      archive(self.size, self.seen, self.stride);
      archive.require(self.size >= 0 && self.size <= kCapacity && self.stride > 0, "too many fixes");
      archive(self.items);
    }
  };
  struct Mean {
    Eigen::Vector2d north_east = Eigen::Vector2d::Zero();
    double weight = 0;      // sum of 1 / sigma^2 [1/m2]
    double best_sigma = 0;  // smallest sigma that entered [m]
    int used = 0, outliers = 0;
  };
  // Of the differences as they are at the moment asked for.
  [[nodiscard]] static std::optional<Mean> meanOf(std::span<const Difference> items) noexcept;
  [[nodiscard]] static std::optional<Mean> meanOf(const Series& series, double unlocked_s,
                                                  double unknown_velocity) noexcept;

  double usbl_shared_;
  Series gps_, usbl_;
  Counters counters_;
};

}  // namespace fathom::nav
