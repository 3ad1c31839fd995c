#include "recon/topside/pieces/tile_blocks.hpp"

#include <Eigen/Geometry>

#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/topside/work/mesh_bytes.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::topside {

template <typename Archive>
void exchangeState(Archive& archive, Is<TileRecord> auto& r) {
  archive(r.tile.level, r.tile.x, r.tile.y, r.low, r.high, r.error, r.texel, r.vertices, r.triangles, r.area,
          r.surface_bytes, r.picture_bytes, r.gpu_bytes);
}

namespace {

TileRecord recordOf(const TexturedTile& tile) {
  TileRecord record;
  const Mesh& mesh = tile.surface.mesh;
  record.tile = tile.surface.tile;
  record.error = tile.surface.error;
  record.texel = tile.texel;
  record.vertices = mesh.vertices.size();
  record.triangles = mesh.triangles.size();
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& v : mesh.vertices) box.extend(v.cast<double>());
  record.low = box.min();
  record.high = box.max();
  for (const auto& [a, b, c] : mesh.triangles)
    record.area +=
        0.5 * static_cast<double>(
                  (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  return record;
}

}  // namespace

std::string tileName(const TileId& tile) {
  return std::to_string(tile.x) + "_" + std::to_string(tile.y);
}

TileBlocks packTile(const TexturedTile& tile, const TexturedTile& reduced, const TileGrid& grid,
                    const ModelSettings& settings) {
  TileBlocks out;
  out.record = recordOf(tile);
  GlbConfig config;
  config.picture = settings.picture;
  if (!tile.atlas.empty() && settings.gpu_texture != GpuTexture::kNone) {
    const BlockTexture blocks = compressBlocks(tile.atlas);
    const bool ktx2 = settings.gpu_texture == GpuTexture::kKtx2;
    out.gpu_texture = ktx2 ? writeKtx2(blocks, Supercompression::kZstd) : writeDds(blocks);
    config.gpu_texture = tileName(tile.surface.tile) + (ktx2 ? ".ktx2" : ".dds");
  }
  GlbFacts facts;
  out.glb = writeGlb(tile, grid, config, &facts);
  out.record.surface_bytes = facts.total_bytes - facts.picture_bytes;
  out.record.picture_bytes = facts.picture_bytes;
  out.record.gpu_bytes = out.gpu_texture.size();
  out.feed = tileBytes(reduced);
  return out;
}

void writeTiles(WorkFileWriter& file, const std::vector<TileBlocks>& tiles) {
  std::vector<TileRecord> records;
  for (const TileBlocks& tile : tiles) {
    const std::string name = tileName(tile.record.tile);
    file.add("glb " + name, tile.glb);
    if (!tile.gpu_texture.empty()) file.add("gpu " + name, tile.gpu_texture);
    file.add("feed " + name, tile.feed);
    if (!tile.patch.empty()) file.add("patch " + name, tile.patch);
    records.push_back(tile.record);
  }
  saveBlock(file, "tiles", records);
}

std::vector<TileRecord> readRecords(const WorkFile& file) {
  return loadBlock<std::vector<TileRecord>>(file, "tiles");
}

TexturedTile readFeed(const WorkFile& file, const TileId& tile) {
  TexturedTile out;
  if (!loadTile(file.read("feed " + tileName(tile)), out)) throw DamagedWork(file.path());
  return out;
}

}  // namespace fathom::topside
