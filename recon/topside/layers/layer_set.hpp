#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "recon/fusion/cell_statistics.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/topside/layers/dive_track.hpp"
#include "recon/topside/layers/layer_patch.hpp"

namespace fathom::topside {

struct LayerConfig {
  LayerCells cells;
  double slope_window = 0.25;    // edge of the square to which slope and aspect fit a plane [m]
  double rugosity_window = 1.0;  // the same for rugosity [m]
  double min_coverage = 0.5;     // share of a window that must be known
  double track_cell = 0.25;      // of layers along the track [m]
  double track_radius = 1.0;     // how far a sample on the track is drawn [m]
  int mosaic_quality = 85;       // of the orthomosaic's WebP; 0: lossless deflate
  int picture_pixels = 900;      // longer side of the quicklooks [px]; 0: none
  int threads = 1;               // that compress; the files do not depend on it
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
  Geodetic origin;
  TileGrid grid;
  std::vector<TileId> tiles;  // leaf tiles that have a patch
  // A tile's packed patch; empty: it has none after all.
  std::function<std::vector<std::uint8_t>(const TileId&)> patch;
  const fusion::CellStatistics* statistics = nullptr;  // for "meshes" and "deviation"; may be null
  const std::vector<TrackPoint>* track = nullptr;      // for "altitude", water; may be null
};

// Writes OUT/layers/*.tif (cloud-optimised GeoTIFF) and *.png, and tells what it wrote, in a fixed order:
// elevation, orthomosaic, slope, aspect, rugosity, views, uncertainty, meshes, deviation, altitude, and what
// water properties there are. Layers without one value are left out. Memory is bounded: blocks of 512 x 512
// cells are computed when GDAL asks for them, patches are kept up to 192 MiB; the statistics are the
// caller's. An orthomosaic of more than 2^32 cells is made of coarser ones (factor 2, 4, ...). Throws
// std::runtime_error when a file cannot be written.
std::vector<LayerInfo> writeLayers(const std::filesystem::path& out, const LayerInputs& inputs,
                                   const LayerConfig& config);

// Well-known text of the layers' reference system: transverse Mercator on WGS84 about the origin, scale 1
// (recon/geometry/geodesy); x east, y north.
[[nodiscard]] std::string layersWkt(const Geodetic& origin);

}  // namespace fathom::topside
