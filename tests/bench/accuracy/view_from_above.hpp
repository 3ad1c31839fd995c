#pragma once

#include <opencv2/core.hpp>

#include "recon/geometry/se3.hpp"
#include "recon/geometry/textured_tile.hpp"
#include "sim/sea/appearance.hpp"

namespace fathom::accuracy {

// Squares of nav's plane seen from straight above, north up.
struct Canvas {
  double north = 0, west = 0;  // of the top left corner [m]
  double pixel = 0.01;         // [m]
  int columns = 0, rows = 0;
  [[nodiscard]] double northOf(int row) const { return north - (row + 0.5) * pixel; }
  [[nodiscard]] double eastOf(int column) const { return west + (column + 0.5) * pixel; }
};

// A model's colours, or the truth's, on a canvas.
struct ViewFromAbove {
  explicit ViewFromAbove(const Canvas& canvas);
  Canvas canvas;
  cv::Mat colour;  // CV_32FC3, red green blue
  cv::Mat depth;   // CV_32F, nav [m]; infinite where nothing is
};

// Draws a tile's uppermost surface with its atlas (or its colours by vertex), bilinearly; an atlas finer than
// the canvas is averaged first.
void drawTile(const TexturedTile& tile, ViewFromAbove& view);

// The true appearance, albedo times how much it faces up, at the places where `like` shows something, after
// `T_truth_model` and a further shift {north, east} [m].
[[nodiscard]] ViewFromAbove drawTruth(const sim::Appearance& truth, const ViewFromAbove& like,
                                      const SE3& T_truth_model, const Eigen::Vector2d& shift);

}  // namespace fathom::accuracy
