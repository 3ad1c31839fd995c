#pragma once

#include <optional>
#include <string>
#include <utility>

#include "realtime/base/units.hpp"
#include "recon/geometry/height_tile.hpp"
#include "sim/link/channel.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"

namespace fathom::test {

inline constexpr std::int64_t kStart_ns = 1'790'000'000 * kSecond_ns;
inline constexpr telemetry::LinkIdentity kIdentity{7, 1234};

[[nodiscard]] std::int64_t nanoseconds(double seconds);

// What was drawn.
struct Plan {
  telemetry::LinkSchedulerConfig link;
  sim::ChannelConfig up, down;
  int side = 3;
  double storm_s = 0, step_s = 0.2, change_every_s = 0;
  bool answers = true;
  double ship_from_s = 0;
  std::vector<double> vehicle_restarts, ship_restarts, lost_files, damaged_files;
  bool key = true;
  std::vector<std::pair<double, double>> ship_clock;     // from then on so far ahead of the true time [s]
  std::vector<std::pair<double, double>> vehicle_clock;  // the vehicle's, from a restart on; never set back
  std::vector<std::pair<double, double>> full_disk;      // of the ship, from to [s]
  std::vector<double> requests;                          // from the ship at these times [s]
  bool listener = false;                                 // a second ship that receives and never speaks
};

[[nodiscard]] std::optional<telemetry::LinkKey> keyOf(const Plan& plan);
[[nodiscard]] Plan draw(std::mt19937& random);
[[nodiscard]] std::string describe(const Plan& plan);
// So far is a clock ahead at `now_ns`; see Plan.
[[nodiscard]] std::int64_t aheadAt(const std::vector<std::pair<double, double>>& steps, std::int64_t now_ns);

// How much longer preambles make everything, and padding the ship's turns.
struct Slowness {
  double sending = 1, turns = 1;
};
[[nodiscard]] Slowness slowness(const Plan& plan);

// The vehicle's map in a storm: squares of 4 m that appear, grow, move, empty and come again.
class Ground {
 public:
  static constexpr double kSquare_m = 4;

  explicit Ground(int side) : side_(side), squares_(static_cast<std::size_t>(side * side)) {}

  [[nodiscard]] std::size_t size() const { return squares_.size(); }
  // Something happens to a square, early in the dive mostly that it appears. Its index.
  std::size_t change(std::mt19937& random);
  // What the vehicle would offer; a square that was emptied has nothing seen.
  [[nodiscard]] const HeightTile& tile(std::size_t square) const;
  // The coarse square of 16 m that holds it, with the nodes that the fine ones have there.
  [[nodiscard]] HeightTile coarse(std::size_t square) const;
  // A quarter of it (0 to 3) at half the spacing, seen whole.
  [[nodiscard]] const HeightTile& detail(std::size_t square, int quarter) const;
  // The square of a place [m]; nothing outside.
  [[nodiscard]] std::optional<std::size_t> squareAt(double north, double east) const;
  // Seen once, now or before.
  [[nodiscard]] bool known(std::size_t square) const { return squares_[square].known; }

 private:
  struct Square {
    bool known = false, empty = false;
    double seen = 1, rise_m = 0;
    // Computed when asked for.
    mutable std::unique_ptr<HeightTile> tile;
    mutable std::array<std::unique_ptr<HeightTile>, 4> details;
  };
  void apply(const Square& square, HeightTile& tile) const;
  int side_;
  std::vector<Square> squares_;
};

}  // namespace fathom::test
