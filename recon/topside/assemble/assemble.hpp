#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/products/rasters/layer_set.hpp"
#include "recon/topside/dive.hpp"
#include "recon/topside/report/map_picture.hpp"

namespace fathom::topside {

// What the model came to, level by level, for scene.json and the report.
struct LevelSummary {
  int level = 0;
  std::size_t tiles = 0;
  std::uint64_t vertices = 0, triangles = 0;
  double area = 0, error = 0, texel = 0;  // [m^2]; greatest [m]; finest [m]
  std::uint64_t surface_bytes = 0, picture_bytes = 0, gpu_bytes = 0;
};

struct Assembled {
  std::vector<LevelSummary> levels;
  std::vector<LayerInfo> layers;
  std::uint64_t vertices = 0, triangles = 0;  // of mesh.ply
  MapExtent extent;                           // of the same
};

// Writes tiles/, layers/, mesh.ply, the poses, closures.csv, track.json, images.json, the tables of images
// and scene.json of a finished dive into `out`.
[[nodiscard]] Assembled assemble(Dive& dive, const FuseResult& fused, const std::filesystem::path& out);

}  // namespace fathom::topside
