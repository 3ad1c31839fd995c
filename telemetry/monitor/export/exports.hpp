#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "telemetry/monitor/model/model_view.hpp"

namespace fathom::monitor {

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
