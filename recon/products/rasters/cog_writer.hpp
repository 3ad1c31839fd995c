#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "recon/geometry/geodesy.hpp"
#include "recon/products/rasters/layer_patch.hpp"

namespace fathom::topside {

// A raster that is computed where it is asked for.
struct RasterSource {
  CellWindow extent;    // must hold a cell
  double cell = 0;      // [m]
  bool colour = false;  // 4 bands of 8 bits (RGBA); else one of 32-bit floats, NaN for no data
  std::function<bool(const CellWindow&)> touches;  // false: surely nothing there
  // Rows from low to high north. float*, or std::uint8_t* with 4 bytes a cell. Asked once for each block.
  std::function<void(const CellWindow&, void*)> fill;
};

struct CogOptions {
  std::optional<Geodetic> origin;  // of the transverse Mercator in which cells are metres north and east
  std::string description, unit;
  bool average = true;  // overviews: means of known cells, else one of them (directions, counts)
  int quality = 0;      // of WebP for colours; 0: deflate
};

// Writes a cloud-optimised GeoTIFF: blocks of 512 x 512, overviews down to one block, blocks without data
// left out, coordinate system: transverse Mercator on WGS84 about the origin, scale 1, or none. The layout is
// that of GDAL's COG driver, leaders and trailers of blocks included, which readers use to save requests;
// GDAL's validation passes it. It is written here because that driver reads a raster several times whole,
// also where nothing is: it took 49 ms a leaf tile in a dense survey and 150 in a cross-shaped one, this
// takes a third and does not look at empty places at all.
//
// Blocks are made quarter by quarter, each level's from the one below, so that memory is a few blocks; what
// is encoded waits beside `path` in "<path>.blocks.tmp". BigTIFF where it must be. Throws std::runtime_error.
void writeCog(const std::filesystem::path& path, const RasterSource& source, const CogOptions& options);

constexpr int kCogBlock = 512;  // [cells]

}  // namespace fathom::topside
