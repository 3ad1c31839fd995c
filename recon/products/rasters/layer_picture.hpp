#pragma once

#include <filesystem>
#include <string>

#include "recon/geometry/mesh.hpp"
#include "recon/products/rasters/terrain.hpp"

namespace fathom::topside {

struct PictureText {
  std::string title, unit;
  double min = 0, max = 0;
  std::string ramp;  // "viridis", "magma", "turbo", "cividis", "twilight"; empty: own colours
};

// Of a ramp, 0 its beginning, 1 its end.
[[nodiscard]] Rgb rampColour(const std::string& ramp, double part);

// A quicklook: the raster in the ramp's colours on white (elevation: shaded from the north-west), with title,
// legend and a bar of length. Throws std::runtime_error when it cannot be written.
void drawLayer(const std::filesystem::path& path, const ReducedRaster& raster, const PictureText& text,
               bool shaded);

}  // namespace fathom::topside
