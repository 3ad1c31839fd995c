#pragma once

#include <filesystem>
#include <string>

namespace fathom::topside {

// The finest tiles' pictures seen from straight above, north up, with cells of one texel: red, green, blue
// and alpha as a GeoTIFF in the dive's own system, tile by tile, so that memory does not grow with the dive.
// A tile without a picture has the colours of its vertices. Throws InputError for results without tiles.
void drawTilesFromAbove(const std::filesystem::path& path, const std::filesystem::path& results);

struct OrthomosaicConfig {
  std::string crs;        // "EPSG:32755"; empty: none, of a dive without a place
  double cell = 0;        // edge of a cell [unit of the system]; 0: about a texel's
  bool lossless = false;  // deflate and an alpha band, else JPEG (quality 85) and a mask
};

// The finest tiles' pictures from above (drawTilesFromAbove()), which have the images' own resolution, in any
// coordinate reference system: a cloud-optimised GeoTIFF, by GDAL's warper (cubic). Throws InputError for
// results without tiles and for a system that GDAL does not know, std::runtime_error with what GDAL says
// where the warp fails.
void writeOrthomosaic(const std::filesystem::path& path, const std::filesystem::path& results,
                      const OrthomosaicConfig& config);

}  // namespace fathom::topside
