#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/products/exports/sparse_model.hpp"
#include "recon/products/rasters/layer_set.hpp"
#include "recon/products/tables/dive_tables.hpp"
#include "recon/topside/dive.hpp"
#include "recon/topside/report/overlap_colours.hpp"

namespace fathom::topside {

// The dive's track second by second: dead reckoning, moved as localisation moved the pairs before and after.
// Without navigation the pairs; a point without a pose stands between parts that nothing joins.
[[nodiscard]] std::vector<DiveTrackPoint> trackOf(Dive& dive, const FuseResult& fused, const WaterLog& water);
// The pairs that have a pose.
[[nodiscard]] std::vector<ImageRow> imageRowsOf(Dive& dive, const FuseResult& fused, const WaterLog& water);

// Of a dive that was localised and whose work is still there; nothing is made again but the matches between
// pairs, which no work file keeps: localisation's links, each registered once more about its own result.
// Points of pairs without features (poses that were given, --no-slam) are none. Colours are those of the
// corrected left image. Takes about 250 bytes a feature. Throws InputError for a dive without images, or
// whose stages are not there.
[[nodiscard]] SparseModel sparseModelOf(Dive& dive);

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
