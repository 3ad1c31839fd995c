#include "recon/topside/pieces/piece_stage.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <optional>

#include "recon/surface/atlas.hpp"
#include "recon/surface/bake.hpp"
#include "recon/surface/simplify.hpp"
#include "recon/topside/work/run_stage_times.hpp"
#include "recon/topside/work/saved_bytes.hpp"
#include "recon/topside/work/stage_runner.hpp"

namespace fathom::topside {

template <typename Archive>
void exchangeState(Archive& archive, Is<PieceFacts> auto& f) {
  archive(f.fusion, f.meshes, f.texels, f.unseen, f.occluded, f.outvoted);
}

namespace {

// Changes whenever the same inputs and settings give another result.
constexpr std::uint32_t kPieceVersion = 12;

// Seconds of several threads by step.
class SharedCosts {
 public:
  void add(const char* step, double seconds) {
    const std::lock_guard lock(mutex_);
    costs_[step] += seconds;
  }
  [[nodiscard]] Costs take() { return std::move(costs_); }

 private:
  std::mutex mutex_;
  Costs costs_;
};

fusion::VolumetricConfig fusionConfig(const PieceInputs& in, const fusion::Piece& piece) {
  fusion::VolumetricConfig config = in.config->fusion;
  config.min_area = in.config->min_component;
  config.overlap = in.config->model.division.overlap;
  config.bounds = fusion::FusionBounds{in.grid, piece.core};
  config.statistics = in.statistics;
  return config;
}

// The deviations that the ramp may follow: those of the cells about the piece's meshes.
void addDeviations(Hasher& hasher, const PieceInputs& in, const fusion::Piece& piece) {
  std::array<std::int32_t, 4> range{INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};  // as a footprint's box
  const double edge = in.statistics->cell();
  for (const std::uint32_t pair : piece.meshes)
    for (std::size_t k = 0; k < 4; ++k) {
      const auto cell = static_cast<std::int32_t>(std::floor((*in.footprints)[pair].box[k] / edge));
      range[k] = k < 2 ? std::min(range[k], cell) : std::max(range[k], cell);
    }
  for (std::int32_t x = range[0]; x <= range[2]; ++x)
    for (std::int32_t y = range[1]; y <= range[3]; ++y) {
      const auto cell = in.statistics->at((x + 0.5) * edge, (y + 0.5) * edge);
      if (cell && cell->deviation > 0) hasher.add(x, y, cell->deviation);
    }
}

surface::ViewIndex viewsOf(const PieceInputs& in, const fusion::Piece& piece) {
  std::vector<surface::View> views;
  for (const std::uint32_t pair : piece.meshes) {
    if (in.prepared->facts()[pair].unlit) continue;
    for (std::uint32_t camera = 0; camera < in.cameras->size(); ++camera)
      views.push_back({viewOf(pair, camera, in.cameras->size()),
                       (*in.T_nav_cam)[pair] * (*in.cameras)[camera].T_left_cam, (*in.footprints)[pair].box,
                       camera});
  }
  return surface::ViewIndex(std::move(views));
}

// The surfaces of a tile and its neighbours, for what hides what.
std::vector<const Mesh*> around(const std::vector<TileMesh>& tiles, const TileId& middle) {
  std::vector<const Mesh*> near;
  for (const TileMesh& tile : tiles)
    if (std::abs(tile.tile.x - middle.x) <= 1 && std::abs(tile.tile.y - middle.y) <= 1)
      near.push_back(&tile.mesh);
  return near;
}

// Makes single tiles of a piece; one object for all threads.
class TileMaker {
 public:
  TileMaker(const PieceInputs& in, const fusion::Piece& piece, const std::vector<TileMesh>& raw)
      : in_(in), raw_(raw), views_(viewsOf(in, piece)) {}

  TileBlocks make(const TileMesh& raw) {
    const ModelSettings& settings = in_.config->model;
    ThreadStopwatch watch;
    TileMesh surface = surface::simplify(raw, trianglesPerSquareMetre(in_.grid, 0));
    costs.add("simplify", watch.lap());
    TexturedTile tile;
    if (in_.images != nullptr)
      tile = texture(surface, watch);
    else
      tile.surface = std::move(surface);
    TexturedTile reduced = tile.atlas.empty() ? tile : surface::quarterAtlas(tile);
    if (!tile.atlas.empty()) surface::colourVertices(reduced);
    TileBlocks out = packTile(tile, reduced, in_.grid, settings);
    costs.add("encode", watch.lap());
    // The reduced texture is as good where a cell of the mosaic takes in all of its texels.
    const TexturedTile& drawn = reduced.texel <= in_.cells.mosaic ? reduced : tile;
    out.patch = packLayerPatch(makeLayerPatch(drawn, in_.grid, in_.cells));
    costs.add("layers", watch.lap());
    return out;
  }

  SharedCosts costs;
  std::uint64_t texels = 0, unseen = 0, occluded = 0, outvoted = 0;

 private:
  TexturedTile texture(const TileMesh& surface, ThreadStopwatch& watch) {
    const ModelSettings& settings = in_.config->model;
    surface::AtlasConfig config;
    config.texel = in_.texel;
    config.max_edge = settings.max_atlas;
    surface::Atlas atlas = surface::makeAtlas(surface, config);
    costs.add("atlas", watch.lap());
    auto& blender = blenders_.local();
    if (!blender) {
      std::vector<Camera> cameras;
      for (const TextureCamera& one : *in_.cameras) cameras.push_back(one.camera);
      blender.emplace(std::move(cameras), settings.blend);
    }
    double reading = 0;
    const surface::TextureBlender::BandSource source = [&](std::uint32_t view) {
      ThreadStopwatch own;
      auto image = in_.images->get(view);
      reading += own.lap();
      return image;
    };
    const surface::BlendCounts counts = blender->blend(
        atlas, views_, views_.meeting(in_.grid.box(surface.tile)), around(raw_, surface.tile), source);
    costs.add("images", reading);
    costs.add("texture", watch.lap() - reading);
    const std::lock_guard lock(mutex_);
    texels += counts.texels;
    unseen += counts.unseen;
    occluded += counts.occluded;
    outvoted += counts.outvoted;
    return std::move(atlas.tile);
  }

  const PieceInputs& in_;
  const std::vector<TileMesh>& raw_;
  surface::ViewIndex views_;
  oneapi::tbb::enumerable_thread_specific<std::optional<surface::TextureBlender>> blenders_;
  std::mutex mutex_;
};

}  // namespace

Digest pieceKey(const PieceInputs& in, const fusion::Piece& piece, const Digest& lighting,
                const std::vector<Digest>& image_identities) {
  const ModelSettings& m = in.config->model;
  Hasher hasher;
  hasher.add("piece", kPieceVersion, piece.core.x0, piece.core.y0, piece.core.x1, piece.core.y1,
             in.grid.voxel, in.grid.leaf_voxels, in.texel, in.cells.surface, in.cells.mosaic,
             m.division.overlap);
  const fusion::VolumetricConfig& c = in.config->fusion;
  hasher.add(c.voxel, c.truncation, c.min_observations, c.border, c.carve, in.config->min_component);
  addModelSettings(hasher, *in.config);
  addDeviations(hasher, in, piece);
  addRig(hasher, *in.input);
  if (in.input->region) hasher.add(in.input->region->identity());
  const bool textured = in.images != nullptr;
  hasher.add(textured);
  if (textured) hasher.add(lighting);
  hasher.add(in.light->water.share);
  if (in.light->water.share > 0)
    for (const lighting::Attenuation& a : in.light->water.colours) hasher.add(a.power, a.per_metre);
  for (const std::uint32_t pair : piece.meshes) {
    hasher.add(in.prepared->meshDigest(pair));
    addPose(hasher, (*in.T_nav_cam)[pair]);
    in.doubt.addKey(hasher, pair);
    hasher.add(in.light->gains[pair]);
    if (!textured) continue;
    hasher.add(image_identities[pair]);
    addPlane(hasher, (*in.planes)[pair]);
  }
  return hasher.finish();
}

Costs makePiece(const PieceInputs& in, const fusion::Piece& piece, WorkFileWriter& file) {
  ThreadStopwatch watch;
  PieceFacts facts;
  std::vector<TileMesh> raw;
  SharedCosts costs;
  {
    fusion::VolumetricFusion fusion(fusionConfig(in, piece));
    for (const std::uint32_t pair : piece.meshes) {
      Mesh mesh = in.prepared->mesh(pair);
      relight(mesh, static_cast<double>(in.light->gains[pair]), in.light->fall);
      const SE3& T_nav_cam = (*in.T_nav_cam)[pair];
      transform(mesh, T_nav_cam);
      fusion.integrate(mesh, T_nav_cam.translation());
    }
    facts.fusion = fusion.counters();
    facts.meshes = piece.meshes.size();
    raw = fusion.extractTiles(in.grid, in.images != nullptr ? 1 : 0);
  }
  costs.add("fusion", watch.lap());
  std::vector<TileMesh> core;
  const std::vector<UncertainView> views = in.doubt.viewsOf(piece.meshes, *in.T_nav_cam, *in.footprints);
  for (const TileMesh& tile : raw) {
    if (!piece.core.contains(tile.tile)) continue;
    TileMesh kept = in.input->region ? in.input->region->inside(tile) : tile;
    if (kept.mesh.empty()) continue;
    addPoseVariance(views, kept.mesh);
    core.push_back(std::move(kept));
  }

  TileMaker maker(in, piece, raw);
  std::vector<TileBlocks> tiles(core.size());
  // In order, so that tiles that are made at once are neighbours, and want the same images.
  inOrder(core.size(), threadsAllowed(), [&](std::size_t k) { tiles[k] = maker.make(core[k]); });
  facts.texels = maker.texels;
  facts.unseen = maker.unseen;
  facts.occluded = maker.occluded;
  facts.outvoted = maker.outvoted;
  writeTiles(file, tiles);
  saveBlock(file, "facts", facts);
  Costs all = maker.costs.take();
  for (const auto& [step, seconds] : costs.take()) all[step] += seconds;
  return all;
}

PieceFacts readPieceFacts(const WorkFile& file) {
  return loadBlock<PieceFacts>(file, "facts");
}

}  // namespace fathom::topside
