#pragma once

#include <array>
#include <string>
#include <string_view>

#include "telemetry/monitor/model/model_view.hpp"

namespace fathom::monitor {

struct Export {
  std::string bytes;                              // empty: there is nothing to export yet
  std::string why;                                // then the reason, for people
  const char* type = "application/octet-stream";  // MIME
};

// What can be taken away from a monitor, by file name.
inline constexpr std::array<std::string_view, 4> kExportNames{"map.ply", "elevation.tif", "colour.tif",
                                                              "track.geojson"};

// Makes one of kExportNames from what has been received. Throws std::runtime_error when GDAL fails.
[[nodiscard]] Export makeExport(ModelView& view, std::string_view name);

// The track and the vehicle as GeoJSON (WGS84 degrees, height = minus depth); empty without the mission's
// origin.
[[nodiscard]] std::string trackGeoJson(const ModelView& view);

}  // namespace fathom::monitor
