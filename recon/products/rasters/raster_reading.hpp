#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

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

}  // namespace fathom::topside
