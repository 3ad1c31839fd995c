#pragma once

#include <filesystem>
#include <string>

namespace fathom::topside {

struct OrthomosaicConfig {
  std::string crs;        // "EPSG:32755"
  double cell = 0;        // edge of a cell [unit of the system]; 0: as wide as the layer's
  bool lossless = false;  // deflate and an alpha band, else JPEG (quality 85) and a mask
};

// The run's orthomosaic in another coordinate reference system: a cloud-optimised GeoTIFF, by GDAL's warper
// (cubic) from RESULTS/layers/orthomosaic.tif. A finer cell than that layer's shows nothing more. Throws
// InputError for results without the layer and for a system that GDAL does not know, std::runtime_error with
// what GDAL says where the warp fails.
void writeOrthomosaic(const std::filesystem::path& path, const std::filesystem::path& results,
                      const OrthomosaicConfig& config);

}  // namespace fathom::topside
