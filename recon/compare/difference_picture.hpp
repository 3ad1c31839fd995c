#pragma once

#include <filesystem>

#include "recon/compare/height_map.hpp"

namespace fathom::compare {

// North up, red where the survey lies above the reference, blue below; ends of the scale at +-`limit` [m];
// with a legend and a scale bar. PNG.
void drawDifference(const HeightMap& difference, double limit, const std::filesystem::path& png);
// Heights between `low` and `high` [m] by colour (viridis), shaded from the north-west, with a legend.
void drawHeights(const HeightMap& map, double low, double high, const std::filesystem::path& png);
// float32 GeoTIFF (COG), NaN where unknown; georeferenced where the frame is known.
void writeGeoTiff(const HeightMap& map, const PlaneFrame& frame, const std::filesystem::path& tif);

}  // namespace fathom::compare
