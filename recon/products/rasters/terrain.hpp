#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "recon/products/rasters/layer_patch.hpp"

namespace fathom::topside {

// A raster file's content, reduced to at most `pixels` on its longer side, top row first. Values of rasters
// of floats, rgba of colours.
struct ReducedRaster {
  int width = 0, height = 0;
  double pixel = 0;            // edge [m]
  double north = 0, west = 0;  // of the top left corner [m]
  std::vector<float> values;
  std::vector<std::uint8_t> rgba;
};
// By GDAL, from the overviews. Throws std::runtime_error.
[[nodiscard]] ReducedRaster readReduced(const std::filesystem::path& path, int pixels);

// Elevations with a border around what is asked for: `halo` cells on every side.
struct TerrainView {
  const float* elevation = nullptr;  // (rows + 2 halo) x (columns + 2 halo), NaN unknown [m, up]
  std::int32_t rows = 0, columns = 0, halo = 0;
  double cell = 0;  // [m]
};
struct TerrainWindow {
  int radius = 1;             // of the square: 2 radius + 1 cells wide; at most the halo
  double min_coverage = 0.5;  // share of its cells that must be known
};
// The radius whose square is `edge` wide at least, 3 cells at the least.
[[nodiscard]] int radiusOf(double edge, double cell);

// Slope [degrees] and aspect (degrees from true north, the direction in which the ground falls; NaN where it
// is level) of the plane that fits the known elevations in the square about each cell best (Evans 1980 fits a
// 3 x 3 square likewise; Friedman et al. 2012 any).
struct SlopeAspect {
  std::vector<float> slope, aspect;
};
[[nodiscard]] SlopeAspect slopeAspect(const TerrainView& view, const TerrainWindow& window);

// Rugosity as in Friedman, Pizarro, Williams and Johnson-Roberson, PLoS ONE 2012, for such stereo models:
// area of the surface in the square over its area projected onto the plane of best fit, so that a slope alone
// gives 1 (arc-chord ratio of Du Preez 2015). The surface is two triangles for every four neighbouring cells,
// the mean of both cuts.
[[nodiscard]] std::vector<float> rugosity(const TerrainView& view, const TerrainWindow& window);

}  // namespace fathom::topside
