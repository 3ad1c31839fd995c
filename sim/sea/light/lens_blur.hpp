#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "sim/sea/optics.hpp"

namespace fathom::sim {

// What lies between a sharp image of the scene and the sensor. Images are floats of `channels` interleaved
// channels.
struct BlurImage {
  std::vector<float>& values;
  int width, height, channels;
};

// Gaussian blur in place; edges repeat.
void blur(const BlurImage& image, double sigma_px);

// The mean over what passes a pixel while the shutter or the flash is open: `shift` says by how much the
// scene at a pixel moves [px].
void motionBlur(const BlurImage& image, const std::function<Eigen::Vector2f(int x, int y)>& shift);

// Defocus: a point at 1/r makes a disc of aperture * focal |1/r - 1/focus| pixels across (thin lens); nothing
// for a point aperture. `inverse_range` of each pixel [1/m].
void defocus(const BlurImage& image, const std::vector<float>& inverse_range, double aperture_px_m,
             double focus_m);
[[nodiscard]] float discAcross(float inverse_range, double aperture_px_m, double focus_m);  // [px]

// Light that the water scatters forward, by small angles, on its way from the ground: the share 1 - exp(-k r)
// of each pixel's is spread (Jaffe 1990's forward component, its spread Gaussian).
void forwardScatter(const BlurImage& image, const std::vector<float>& inverse_range, double per_metre,
                    double spread_px);

}  // namespace fathom::sim
