#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "recon/topside/layers/layer_patch.hpp"

namespace fathom::topside {

// A raster that is computed where it is asked for.
struct RasterSource {
  CellWindow extent;    // must hold a cell
  double cell = 0;      // [m]
  bool colour = false;  // 4 bands of 8 bits (RGBA); else one of 32-bit floats, NaN for no data
  std::function<bool(const CellWindow&)> touches;  // false: surely nothing there
  // Rows from low to high north. float*, or std::uint8_t* with 4 bytes a cell.
  std::function<void(const CellWindow&, void*)> fill;
};

struct CogOptions {
  std::string wkt;
  std::string description, unit;
  bool average = true;  // overviews: means of known cells, else the nearest (directions, counts)
  int quality = 0;      // of WebP for colours; 0: deflate
  int threads = 1;
};

// Writes a cloud-optimised GeoTIFF (GDAL's COG driver): blocks of 512 x 512, overviews, blocks without data
// left out. Throws std::runtime_error.
void writeCog(const std::filesystem::path& path, const RasterSource& source, const CogOptions& options);

constexpr int kCogBlock = 512;  // [cells]

// A file's content, reduced to at most `pixels` on its longer side, top row first. Values for rasters of
// floats, rgba for colours.
struct ReducedRaster {
  int width = 0, height = 0;
  double pixel = 0;            // edge [m]
  double north = 0, west = 0;  // of the top left corner [m]
  std::vector<float> values;
  std::vector<std::uint8_t> rgba;
};
[[nodiscard]] ReducedRaster readReduced(const std::filesystem::path& path, int pixels);

}  // namespace fathom::topside
