// Fusion of one stereo mesh of about 800 points from 2 m: the onboard quadtree, and the topside's voxels.
// Google Benchmark gives the mean of real time after warm-up. The reference pipeline states 0.47 s a pair for
// stereo, fusion, simplification and meshing together.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "recon/fusion/quadtree_map.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "tests/world/ground.hpp"

namespace fathom::fusion {
namespace {

double reef(double n, double e) {
  return 2.0 + 0.1 * std::sin(3.0 * n) + 0.08 * std::cos(2.5 * e);
}

// Footprints along a line, 0.25 m apart as at 0.5 m/s and 2 Hz; 29 x 28 points.
std::vector<Mesh> track(int count) {
  std::vector<Mesh> meshes;
  for (int k = 0; k < count; ++k)
    meshes.push_back(
        test::rangeMesh({.north = 0.25 * k, .length = 1.2, .width = 1.6, .spacing = 0.049, .sigma = 0.01},
                        reef, static_cast<unsigned>(k)));
  return meshes;
}

QuadtreeConfig onboardConfig(int max_tiles, double spacing) {
  QuadtreeConfig config;
  config.max_level = static_cast<int>(std::lround(std::log2(config.root_size / 16 / spacing)));
  config.max_tiles = max_tiles;
  config.node_spacing_ratio = spacing < 1.0 / 32 ? 0.3 : 0.7;  // 1/64 m is finer than the points
  return config;
}

double spacingOf(const benchmark::State& state) {
  return 1.0 / static_cast<double>(state.range(0));
}

// Argument: cells to a metre. A new mesh each time, with room for all.
void fusionQuadtree(benchmark::State& state) {
  const std::vector<Mesh> meshes = track(200);
  QuadtreeMap map(onboardConfig(8192, spacingOf(state)));
  std::size_t k = 0, cells = 0;
  for (auto _ : state) cells += map.fuse(meshes[k++ % meshes.size()]);
  state.counters["cells"] =
      benchmark::Counter(static_cast<double>(cells), benchmark::Counter::kAvgIterations);
  state.counters["points"] = static_cast<double>(meshes[0].vertices.size());
  state.counters["coarsened"] = static_cast<double>(map.counters().coarsened);
}
BENCHMARK(fusionQuadtree)->ArgName("cells/m")->Arg(16)->Arg(64)->Unit(benchmark::kMillisecond);

// A pool so small that old ground is coarsened all the time; meshes never meet the ground again.
void fusionQuadtreeFull(benchmark::State& state) {
  std::vector<Mesh> meshes = track(200);
  QuadtreeMap map(onboardConfig(256, spacingOf(state)));
  const SE3 onwards(Eigen::Quaterniond::Identity(), Eigen::Vector3d(50, 0, 0));
  for (const Mesh& mesh : meshes) (void)map.fuse(mesh);
  std::size_t k = 0;
  for (auto _ : state) {
    state.PauseTiming();
    Mesh& mesh = meshes[k++ % meshes.size()];
    transform(mesh, onwards);
    state.ResumeTiming();
    benchmark::DoNotOptimize(map.fuse(mesh));
  }
  state.counters["coarsened"] =
      benchmark::Counter(static_cast<double>(map.counters().coarsened), benchmark::Counter::kAvgIterations);
}
BENCHMARK(fusionQuadtreeFull)->ArgName("cells/m")->Arg(16)->Arg(64)->Unit(benchmark::kMillisecond);

// Out and in again, as when a keyframe has moved.
void fusionQuadtreeRemoveAndFuse(benchmark::State& state) {
  const std::vector<Mesh> meshes = track(200);
  QuadtreeMap map(onboardConfig(8192, spacingOf(state)));
  for (const Mesh& mesh : meshes) (void)map.fuse(mesh);
  std::size_t k = 0;
  for (auto _ : state) {
    const Mesh& mesh = meshes[k++ % meshes.size()];
    benchmark::DoNotOptimize(map.remove(mesh));
    benchmark::DoNotOptimize(map.fuse(mesh));
  }
}
BENCHMARK(fusionQuadtreeRemoveAndFuse)->ArgName("cells/m")->Arg(16)->Arg(64)->Unit(benchmark::kMillisecond);

// A square of 0.5 m, full, into its parent of 1 m; 1/64 m to 1/32 m.
void fusionQuadtreeCoarsen(benchmark::State& state) {
  const std::vector<Mesh> meshes = track(200);
  QuadtreeMap map(onboardConfig(8192, 1.0 / 64));
  std::vector<TileKey> parents;
  for (auto _ : state) {
    if (parents.empty()) {
      state.PauseTiming();
      map.clear();
      for (const Mesh& mesh : meshes) (void)map.fuse(mesh);
      for (std::int32_t n = 0; n < 100; ++n) parents.push_back({n, 0, 6});
      state.ResumeTiming();
    }
    benchmark::DoNotOptimize(map.coarsen(parents.back()));
    parents.pop_back();
  }
}
BENCHMARK(fusionQuadtreeCoarsen)->Unit(benchmark::kMicrosecond);

// Argument: level of the tile; 7 are the leaves of 1/64 m, 3 the squares of 4 m that go over the link.
void fusionQuadtreeExtract(benchmark::State& state) {
  const std::vector<Mesh> meshes = track(200);
  QuadtreeMap map(onboardConfig(8192, 1.0 / 64));
  for (const Mesh& mesh : meshes) (void)map.fuse(mesh);
  const auto level = static_cast<std::int16_t>(state.range(0));
  const int across = 20 << level >> 5;  // tiles within the track's 20 m
  HeightTile tile;
  std::int32_t n = 0;
  for (auto _ : state) benchmark::DoNotOptimize(map.extract({n++ % std::max(1, across), 0, level}, tile));
}
BENCHMARK(fusionQuadtreeExtract)->ArgName("level")->Arg(7)->Arg(5)->Arg(3)->Unit(benchmark::kMicrosecond);

void fusionVoxels(benchmark::State& state) {
  const std::vector<Mesh> meshes = track(200);
  VolumetricFusion fusion({.carve = state.range(0) != 0});
  std::size_t k = 0;
  for (auto _ : state) {
    const std::size_t at = k++ % meshes.size();
    fusion.integrate(meshes[at], Eigen::Vector3d(0.25 * static_cast<double>(at), 0, 0));
  }
  state.counters["points"] = static_cast<double>(meshes[0].vertices.size());
  state.counters["MB"] = static_cast<double>(fusion.memoryBytes()) / 1e6;
}
BENCHMARK(fusionVoxels)->ArgName("carve")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void fusionVoxelsExtract(benchmark::State& state) {
  VolumetricFusion fusion({});
  const std::vector<Mesh> meshes = track(200);
  for (std::size_t k = 0; k < meshes.size(); ++k)
    fusion.integrate(meshes[k], Eigen::Vector3d(0.25 * static_cast<double>(k), 0, 0));
  std::size_t triangles = 0;
  for (auto _ : state) triangles = fusion.extract().triangles.size();
  state.counters["triangles"] = static_cast<double>(triangles);
}
BENCHMARK(fusionVoxelsExtract)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::fusion
