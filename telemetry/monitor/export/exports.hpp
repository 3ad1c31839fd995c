#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "telemetry/monitor/map/surface.hpp"
#include "telemetry/monitor/model/model_view.hpp"

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

struct Export {
  std::string bytes;                              // empty: there is nothing to export yet
  std::string why;                                // then the reason, for the operator
  const char* type = "application/octet-stream";  // MIME
};

// The exports, by file name.
inline constexpr std::array<std::string_view, 4> kExportNames{"map.ply", "elevation.tif", "colour.tif",
                                                              "track.geojson"};

// Makes one of kExportNames from the received data. Throws std::runtime_error when GDAL fails.
[[nodiscard]] Export makeExport(ModelView& view, std::string_view name);

// The track and the vehicle as GeoJSON (WGS84 degrees, height = minus depth); empty without the mission's
// origin.
[[nodiscard]] std::string trackGeoJson(const ModelView& view);

// Writes the exports to a folder, each under a temporary name first. When the disk refuses or an export
// fails, trouble() says so and the next save() writes again.
class ExportFiles {
 public:
  explicit ExportFiles(std::filesystem::path folder) : folder_(std::move(folder)) {}
  // Writes the exports that have changed.
  void save(ModelView& view);
  // Why the last save() failed; "": it did not.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

 private:
  std::filesystem::path folder_;
  std::string trouble_;
  std::uint64_t saved_epoch_ = 0, saved_map_ = UINT64_MAX;
  std::size_t saved_track_ = 0;
  bool saved_origin_ = false;
};

}  // namespace fathom::monitor
