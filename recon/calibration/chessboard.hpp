#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "recon/geometry/image_view.hpp"

namespace fathom::calibration {

// A flat chessboard, by its inner corners (where four squares meet).
struct Chessboard {
  int columns = 9, rows = 6;  // inner corners
  double square = 0.024;      // edge of a square [m]

  [[nodiscard]] std::size_t corners() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
};

// Inner corners in one image, row by row [px].
using Corners = std::vector<Eigen::Vector2d>;

// The inner corners on the board: x along a row, y along a column, z = 0 [m].
[[nodiscard]] std::vector<Eigen::Vector3d> boardPoints(const Chessboard& board);

// Finds every inner corner to a fraction of a pixel; std::nullopt when the whole board is not to be seen.
// Mono, RGB or Bayer (its green pixels, the others interpolated), 8 to 16 bits. Which corner comes first may
// differ by the board's symmetry from image to image (see board_pairing.hpp).
[[nodiscard]] std::optional<Corners> findChessboard(const ImageView& image, const Chessboard& board);

}  // namespace fathom::calibration
