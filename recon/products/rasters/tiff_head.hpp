#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"

namespace fathom::topside {

enum class TiffCompression : std::uint16_t { kDeflate = 8, kWebp = 50001 };

// A raster as its TIFF tags tell it.
struct TiffRaster {
  bool colour = false;
  TiffCompression compression = TiffCompression::kDeflate;
  int block = 512;
  double cell = 0, north = 0, west = 0;  // of the finest level: pixel's edge, top left corner [m]
  std::optional<Geodetic> origin;
  std::string description, unit;
};
struct TiffLevel {
  std::uint32_t width = 0, height = 0;  // [px]
  std::vector<std::uint64_t> offsets;   // in the file, of blocks row by row; 0: left out
  std::vector<std::uint32_t> sizes;     // [bytes]
};

// Everything of the file before its first block: header, GDAL's note of the layout, and the directories of
// all levels, finest first. Its size does not depend on the offsets' and sizes' values.
[[nodiscard]] std::vector<std::uint8_t> tiffHead(const TiffRaster& raster,
                                                 const std::vector<TiffLevel>& levels, bool big);

}  // namespace fathom::topside
