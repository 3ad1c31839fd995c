#pragma once

#include <vector>

#include "recon/fusion/cell_statistics.hpp"
#include "recon/fusion/space_division.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/products/rasters/layer_patch.hpp"
#include "recon/topside/config/model_settings.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/pieces/pose_doubt.hpp"
#include "recon/topside/pieces/tile_blocks.hpp"
#include "recon/topside/pieces/view_images.hpp"
#include "recon/topside/prepare/prepared_groups.hpp"
#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

// What pieces are made from. All that it points to must outlive it.
struct PieceInputs {
  const MissionInput* input = nullptr;
  const TopsideConfig* config = nullptr;
  const PreparedGroups* prepared = nullptr;
  const std::vector<SE3>* T_nav_cam = nullptr;  // of every pair; of pairs without a mesh: any
  const std::vector<fusion::MeshFootprint>* footprints = nullptr;  // of every pair
  PoseDoubt doubt;
  const fusion::CellStatistics* statistics = nullptr;  // of all meshes
  const SeedPlanes* planes = nullptr;                  // of every pair
  const GroundLight* light = nullptr;
  const std::vector<TextureCamera>* cameras = nullptr;
  ViewImages* images = nullptr;  // null: no texture
  TileGrid grid;
  double texel = 0;  // finest [m]
  LayerCells cells;
};

// Of a piece's work file, beside its tiles.
struct PieceFacts {
  fusion::VolumetricFusion::Counters fusion;
  std::uint64_t meshes = 0, texels = 0, unseen = 0, occluded = 0, outvoted = 0;
};

// Everything that the piece's result depends on, and nothing else: poses and meshes that reach it, how far
// meshes disagree on their ground, its images, the models and settings.
[[nodiscard]] Digest pieceKey(const PieceInputs& inputs, const fusion::Piece& piece, const Digest& lighting,
                              const std::vector<Digest>& image_identities);

// Fuses the piece's meshes and makes its leaf tiles: simplified, textured, packed, with their part of the
// layers. Tiles are made in parallel; the result does not depend on the number of threads. Returns what it
// has cost: seconds of threads by step.
Costs makePiece(const PieceInputs& inputs, const fusion::Piece& piece, WorkFileWriter& file);
[[nodiscard]] PieceFacts readPieceFacts(const WorkFile& file);  // throws DamagedWork

}  // namespace fathom::topside
