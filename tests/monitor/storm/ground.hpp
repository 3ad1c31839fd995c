#pragma once

#include <array>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "recon/geometry/height_tile.hpp"

namespace fathom::test {

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
