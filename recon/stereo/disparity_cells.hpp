#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace fathom::stereo {

// A rectangle of a disparity image and the plane d = mean + slope . (p - centre) that fits its valid pixels.
struct DisparityCell {
  int x = 0, y = 0, width = 0, height = 0;           // [px]
  int valid = 0;                                     // pixels with a disparity
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // mean of the valid pixels [px]
  double mean = 0;                                   // disparity at the centre [px]
  double rms = 0;                                    // of the residuals [px]
};

// Simplifies a disparity image to about a wanted number of cells: small where the surface bends or breaks,
// large where a plane fits. Greedy, as Garland & Heckbert 1995 ("Fast polygonal approximation of terrains and
// height fields") insert points: the cell with the largest sum of squared residuals, and of area, is cut in
// four next. Sums over any rectangle come from integral images, so the cost is that of the image and n log n
// in the cells.
class DisparityCells {
 public:
  static constexpr int kMinEdge = 4;  // a cell is not cut smaller [px]

  // `disparity`: width * height values [px], NaN where there is none. At most about `wanted` cells that hold
  // a valid pixel, in reading order of their upper left corners. The result is reused by the next call.
  const std::vector<DisparityCell>& simplify(std::span<const float> disparity, int width, int height,
                                             int wanted);

 private:
  static constexpr std::size_t kMoments = 10;  // 1, x, y, xx, xy, yy, d, xd, yd, dd
  using Moments = std::array<double, kMoments>;
  struct Candidate {
    double cost;  // [px^2]
    DisparityCell cell;
  };

  void integrate(std::span<const float> disparity);
  [[nodiscard]] Moments sum(int x, int y, int width, int height) const;
  [[nodiscard]] DisparityCell fit(int x, int y, int width, int height) const;
  void offer(int x, int y, int width, int height);
  void cutWorst();

  int width_ = 0, height_ = 0;
  double offset_ = 0;  // taken off the disparities, so that squares keep their precision [px]
  std::vector<Moments> integral_;
  std::vector<Candidate> heap_;
  std::vector<DisparityCell> cells_;
};

}  // namespace fathom::stereo
