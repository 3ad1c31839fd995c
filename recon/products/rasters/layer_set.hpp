#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "recon/fusion/cell_statistics.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/products/rasters/layer_patch.hpp"
#include "recon/products/tables/dive_tables.hpp"

namespace fathom::topside {

struct LayerConfig {
  LayerCells cells;
  double slope_window = 0.25;    // edge of the square to which slope and aspect fit a plane [m]
  double rugosity_window = 1.0;  // the same for rugosity [m]
  double min_coverage = 0.5;     // share of a window that must be known
  double track_cell = 0.25;      // of layers along the track [m]
  double track_radius = 1.0;     // how far a sample on the track is drawn [m]
  int mosaic_quality = 80;       // of the orthomosaic's WebP; 0: lossless deflate
  int picture_pixels = 900;      // longer side of the quicklooks [px]; 0: none
};

// A layer as scene.json tells it.
struct LayerInfo {
  std::string name, title, unit;
  std::string file;         // relative to the output folder: "layers/slope.tif"
  double min = 0, max = 0;  // of the legend: 2 and 98 % of the values, rounded outwards
  std::string ramp;         // "viridis", ...; empty: the layer has its own colours (orthomosaic)
  std::string picture;      // quicklook with legend: "layers/slope.png"; empty: none
};

struct LayerInputs {
  std::optional<Geodetic> origin;  // none: nobody knows where the dive was
  TileGrid grid;
  std::vector<TileId> tiles;  // leaf tiles that have a patch
  // A tile's packed patch; empty: it has none after all. Asked by several threads at once.
  std::function<std::vector<std::uint8_t>(const TileId&)> patch;
  const fusion::CellStatistics* statistics = nullptr;  // for "meshes" and "deviation"; may be null
  const std::vector<DiveTrackPoint>* track = nullptr;  // for "altitude", water; may be null
};

// Writes OUT/layers/*.tif (cloud-optimised GeoTIFF) and *.png, and tells what it wrote, in a fixed order:
// elevation, orthomosaic, slope, aspect, rugosity, views, uncertainty, meshes, deviation, altitude, and what
// water properties there are. Layers without one value are left out. Layers are made at the same time as
// oneTBB has threads; the files do not depend on how many. Memory is bounded whatever the dive's size (the
// statistics are the caller's): each layer being made keeps patches up to PatchMosaic::kKeptBytes and a few
// blocks. Throws std::runtime_error when a file cannot be written or a patch is broken.
std::vector<LayerInfo> writeLayers(const std::filesystem::path& out, const LayerInputs& inputs,
                                   const LayerConfig& config);

// All files that writeLayers() may write, as a shell pattern (OutputFolder).
inline constexpr std::string_view kLayerFiles =
    "layers/@(elevation|orthomosaic|slope|aspect|rugosity|views|uncertainty|meshes|deviation|altitude|"
    "conductivity|temperature|salinity|sound_speed|chlorophyll|cdom|turbidity).@(tif|png)";

}  // namespace fathom::topside
