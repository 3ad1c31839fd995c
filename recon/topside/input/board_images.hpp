#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/calibration/rig_calibration.hpp"

namespace fathom::topside {

// Which images hold the chessboard.
struct BoardImageOptions {
  std::vector<std::filesystem::path> images;  // files and folders; left and right told apart by name
  std::string left_pattern, right_pattern;    // or two shell patterns, paired in order of name
  std::string left_format = "auto", right_format = "auto";  // mono, bayer-rggb; auto: *_LC16 is a mosaic
};

struct BoardImagePair {
  std::string name;  // the left file's
  std::filesystem::path left, right;
};

// Pairs the images: leftNN with rightNN (the words anywhere in the name, or as the folder's name), and
// PR_..._LC16 with the PR_..._RM16 nearest in time. `alone` gets those without a partner. Throws InputError
// when there is no pair, for an absent file, and for patterns with unequal numbers of images.
[[nodiscard]] std::vector<BoardImagePair> listBoardImages(const BoardImageOptions& options,
                                                          std::vector<calibration::DroppedView>& alone);

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
