#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "recon/calibration/rig_calibration.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/import/images/image_samples.hpp"
#include "recon/import/images/stereo_files.hpp"

namespace fathom::topside {

// One image on its own, ready for stereo: without a mission there is no model of its lighting.
struct LooseImage {
  int width = 0, height = 0;                // [px]
  PixelFormat format = PixelFormat::kMono;  // as read
  int bits = 8;                             // as read
  std::vector<std::uint8_t> mono;           // width * height
  std::vector<std::uint8_t> rgb;            // width * height * 3

  [[nodiscard]] ImageView monoView() const;
  [[nodiscard]] ImageView rgbView() const;
};

// Samples of more than 8 bits are stretched to 8 by one gain and offset for each channel; images of 8 bits
// stay as they are. Throws InputError, also when the size is not the camera's.
[[nodiscard]] LooseImage readLooseImage(const std::filesystem::path& path, Samples samples,
                                        const Camera& camera);

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
