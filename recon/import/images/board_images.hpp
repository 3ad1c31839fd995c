#pragma once

#include <string>
#include <vector>

#include "recon/calibration/rig_calibration.hpp"
#include "recon/import/images/stereo_files.hpp"

namespace fathom::topside {

// Which images hold the chessboard.
struct BoardImageOptions : StereoFileOptions {
  std::string left_format = "auto", right_format = "auto";  // of sampleNames()
};

struct BoardImages {
  calibration::ImageSize left, right;
  std::vector<calibration::BoardView> views;      // with every corner, in both images
  std::vector<calibration::DroppedView> dropped;  // the others: unreadable, or no board
};

// Finds the board in every pair, in parallel, with progress on stderr. Throws InputError for images of mixed
// sizes and when no pair shows the whole board.
[[nodiscard]] BoardImages findBoards(const BoardImageOptions& options, const calibration::Chessboard& board);

// "9x6" to inner corners. Throws InputError.
[[nodiscard]] calibration::Chessboard parseBoard(const std::string& size, double square_m);

}  // namespace fathom::topside
