#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "telemetry/monitor/map/surface.hpp"

namespace fathom::monitor {

// The received surface resampled to a standard projection: UTM in the zone of the mission's origin (UPS
// beyond 84 N and 80 S). Every pixel's centre is transformed into nav and the surface sampled there, so that
// the grid is exact although nav is another projection.
struct GeoRaster {
  int epsg = 0;
  int width = 0, height = 0;         // pixels
  double west = 0, north = 0;        // outer corner of the first pixel [m]
  double pixel = 0;                  // edge [m]
  std::vector<float> elevation;      // row by row from the north, above the sea surface [m]; NaN: no map
  std::vector<std::uint8_t> colour;  // red, green, blue, 255; all 0 without map or colour
};

inline constexpr std::int64_t kMaxPixels = 16'000'000;  // more, and the pixel doubles
inline constexpr double kLeastPixel_m = 1.0 / 16;

[[nodiscard]] int epsgOf(const Geodetic& origin);
// The pixel is the finest spacing that covers a tenth of the map. Nullopt without a map.
[[nodiscard]] std::optional<GeoRaster> rasterOf(const BlockStore& store, Surface& surface,
                                                const Geodetic& origin);

// GeoTIFF files as bytes: 32-bit heights with NaN for no data; red, green, blue, alpha. Throw
// std::runtime_error when GDAL fails.
[[nodiscard]] std::string elevationTiff(const GeoRaster& raster);
[[nodiscard]] std::string colourTiff(const GeoRaster& raster);

}  // namespace fathom::monitor
