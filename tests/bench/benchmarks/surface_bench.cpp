// Simplification of leaf tiles beside its peers on the same tile: OpenMesh's decimater with its quadric
// module (borders locked, normals guarded) and meshoptimizer's simplifier (borders locked). Also what the
// other steps of a tile cost: joining, atlas, texels, baking. Counters: error_mm, a bound of the distance in
// both directions between the surfaces; tri_m2, triangles for a square metre; us_m2, microseconds for a
// square metre.
#include <benchmark/benchmark.h>
#include <meshoptimizer.h>

#include <Eigen/Geometry>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModNormalFlippingT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>

#include "recon/surface/atlas.hpp"
#include "recon/surface/bake.hpp"
#include "recon/surface/simplify.hpp"
#include "recon/surface/surface_error.hpp"
#include "tests/world/ground.hpp"
#include "tests/world/tiles.hpp"

namespace fathom::surface {
namespace {

using test::areaOf;

const TileMesh& leaf() {
  static const TileMesh tile = test::syntheticTile(test::noisyTerrain(0.005, 3), TileGrid{}, {0, 0, 0});
  return tile;
}

void report(benchmark::State& state, const Mesh& from, const Mesh& to) {
  const double area = areaOf(from);
  state.counters["error_mm"] = 1e3 * std::max(distanceBound(from, to, TileGrid::kLattice),
                                              distanceBound(to, from, TileGrid::kLattice));
  state.counters["tri_m2"] = static_cast<double>(to.triangles.size()) / area;
  state.counters["us_m2"] = benchmark::Counter(
      area / 1e6, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void surfaceSimplifyLeaf(benchmark::State& state) {
  TileMesh out;
  for (auto _ : state) out = simplify(leaf(), static_cast<double>(state.range(0)));
  report(state, leaf().mesh, out.mesh);
  state.counters["stated_mm"] = 1e3 * out.error;
}
BENCHMARK(surfaceSimplifyLeaf)->ArgName("tri_m2")->Arg(1000)->Arg(300)->Unit(benchmark::kMillisecond);

using PeerMesh = OpenMesh::TriMesh_ArrayKernelT<>;

Mesh toMesh(PeerMesh& peer) {
  peer.garbage_collection();
  Mesh out;
  for (const auto v : peer.vertices()) {
    const auto& p = peer.point(v);
    out.vertices.emplace_back(p[0], p[1], p[2]);
  }
  for (const auto f : peer.faces()) {
    std::array<std::uint32_t, 3> t;
    std::size_t k = 0;
    for (const auto v : peer.fv_range(f)) t[k++] = static_cast<std::uint32_t>(v.idx());
    out.triangles.push_back(t);
  }
  return out;
}

void surfaceOpenMesh(benchmark::State& state) {
  const Mesh& in = leaf().mesh;
  const auto target = static_cast<std::size_t>(areaOf(in) * static_cast<double>(state.range(0)));
  Mesh out;
  for (auto _ : state) {
    PeerMesh peer;
    peer.request_vertex_status();
    peer.request_edge_status();
    peer.request_halfedge_status();
    peer.request_face_status();
    peer.request_face_normals();
    for (const Eigen::Vector3f& v : in.vertices) peer.add_vertex({v.x(), v.y(), v.z()});
    for (const auto& [a, b, c] : in.triangles)
      peer.add_face(PeerMesh::VertexHandle(static_cast<int>(a)), PeerMesh::VertexHandle(static_cast<int>(b)),
                    PeerMesh::VertexHandle(static_cast<int>(c)));
    for (const auto v : peer.vertices()) peer.status(v).set_locked(peer.is_boundary(v));
    peer.update_face_normals();
    OpenMesh::Decimater::DecimaterT<PeerMesh> decimater(peer);
    OpenMesh::Decimater::ModQuadricT<PeerMesh>::Handle quadric;
    OpenMesh::Decimater::ModNormalFlippingT<PeerMesh>::Handle flipping;
    decimater.add(quadric);
    decimater.add(flipping);
    decimater.module(quadric).unset_max_err();
    decimater.module(flipping).set_max_normal_deviation(70);
    decimater.initialize();
    decimater.decimate_to_faces(0, target);
    out = toMesh(peer);
  }
  report(state, in, out);
}
BENCHMARK(surfaceOpenMesh)->ArgName("tri_m2")->Arg(1000)->Arg(300)->Unit(benchmark::kMillisecond);

void surfaceMeshoptimizer(benchmark::State& state) {
  const Mesh& in = leaf().mesh;
  const auto target = 3 * static_cast<std::size_t>(areaOf(in) * static_cast<double>(state.range(0)));
  std::vector<unsigned> indices;
  for (const auto& t : in.triangles) indices.insert(indices.end(), t.begin(), t.end());
  std::vector<unsigned> result(indices.size());
  std::size_t count = 0;
  for (auto _ : state)
    count = meshopt_simplify(result.data(), indices.data(), indices.size(), in.vertices[0].data(),
                             in.vertices.size(), sizeof(Eigen::Vector3f), target, 1.0F,
                             meshopt_SimplifyLockBorder, nullptr);
  Mesh out;
  out.vertices = in.vertices;
  for (std::size_t i = 0; i < count; i += 3)
    out.triangles.push_back({result[i], result[i + 1], result[i + 2]});
  report(state, in, out);
}
BENCHMARK(surfaceMeshoptimizer)->ArgName("tri_m2")->Arg(1000)->Arg(300)->Unit(benchmark::kMillisecond);

void surfaceDistanceBounds(benchmark::State& state) {
  static const TileMesh coarse = simplify(leaf(), 1000);
  double bound = 0;
  for (auto _ : state)
    bound = std::max(distanceBound(leaf().mesh, coarse.mesh, TileGrid::kLattice),
                     distanceBound(coarse.mesh, leaf().mesh, TileGrid::kLattice));
  state.counters["error_mm"] = 1e3 * bound;
}
BENCHMARK(surfaceDistanceBounds)->Unit(benchmark::kMillisecond);

// 4 x 4 tiles of a level to one of the next.
const std::vector<TileMesh>& sixteen() {
  static const std::vector<TileMesh> tiles = [] {
    std::vector<TileMesh> out;
    for (int x = 0; x < 4; ++x)
      for (int y = 0; y < 4; ++y)
        out.push_back(simplify(
            test::syntheticTile(test::noisyTerrain(0.005, 3), TileGrid{}, {0, x, y}, 1.5, 2.5), 1000));
    return out;
  }();
  return tiles;
}
std::vector<const TileMesh*> pointers() {
  std::vector<const TileMesh*> out;
  for (const TileMesh& tile : sixteen()) out.push_back(&tile);
  return out;
}

void surfaceJoinSixteen(benchmark::State& state) {
  const auto tiles = pointers();
  for (auto _ : state) benchmark::DoNotOptimize(joinTiles(tiles, TileGrid{}, {1, 0, 0}));
}
BENCHMARK(surfaceJoinSixteen)->Unit(benchmark::kMillisecond);

void surfaceSimplifyParent(benchmark::State& state) {
  const TileMesh joined = joinTiles(pointers(), TileGrid{}, {1, 0, 0});
  TileMesh out;
  for (auto _ : state) out = simplify(joined, 100);
  report(state, joined.mesh, out.mesh);
}
BENCHMARK(surfaceSimplifyParent)->Unit(benchmark::kMillisecond);

void surfaceAtlas(benchmark::State& state) {
  static const TileMesh tile = simplify(leaf(), 1000);
  Atlas atlas;
  for (auto _ : state) atlas = makeAtlas(tile, {});
  state.counters["charts"] = static_cast<double>(atlas.charts.size());
  state.counters["texels"] = atlas.width * atlas.height;
}
BENCHMARK(surfaceAtlas)->Unit(benchmark::kMillisecond);

void surfaceBakeParent(benchmark::State& state) {
  std::vector<TexturedTile> children;
  for (const TileMesh& tile : sixteen()) {
    Atlas atlas = makeAtlas(tile, {.texel = 0.0048});
    atlas.tile.atlas = {
        atlas.width, atlas.height,
        std::vector<std::uint8_t>(3 * static_cast<std::size_t>(atlas.width * atlas.height), 90)};
    children.push_back(atlas.tile);
  }
  std::vector<const TexturedTile*> all;
  for (const TexturedTile& child : children) all.push_back(&child);
  const Atlas parent =
      makeAtlas(simplify(joinTiles(pointers(), TileGrid{}, {1, 0, 0}), 100), {.texel = 0.0048});
  for (auto _ : state) benchmark::DoNotOptimize(bakeFromChildren(parent, all));
}
BENCHMARK(surfaceBakeParent)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::surface
