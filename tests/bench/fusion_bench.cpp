// Fusion of one stereo mesh of about 800 points from 2 m: the onboard quadtree, and the topside's voxels.
// Google Benchmark gives the mean of real time after warm-up. The reference pipeline states 0.47 s a pair for
// stereo, fusion, simplification and meshing together.
#include <benchmark/benchmark.h>

#include "recon/fusion/quadtree_map.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "tests/fusion/scene.hpp"

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

QuadtreeConfig onboardConfig(int max_tiles) {
  QuadtreeConfig config;
  config.max_level = 5;  // 1 m tiles, nodes 6.25 cm
  config.max_tiles = max_tiles;
  return config;
}

void quadtreeFuse(benchmark::State& state) {
  const std::vector<Mesh> meshes = track(200);
  QuadtreeMap map(onboardConfig(static_cast<int>(state.range(0))));
  std::size_t k = 0, nodes = 0;
  for (auto _ : state) nodes += map.fuse(meshes[k++ % meshes.size()]);
  state.counters["nodes"] =
      benchmark::Counter(static_cast<double>(nodes), benchmark::Counter::kAvgIterations);
  state.counters["coarsened"] = static_cast<double>(map.counters().coarsened);
}
// With room, and with a pool so small that old ground is coarsened all the time.
BENCHMARK(quadtreeFuse)->Arg(4096)->Arg(64)->Unit(benchmark::kMillisecond);

void volumetricIntegrate(benchmark::State& state) {
  const std::vector<Mesh> meshes = track(200);
  VolumetricConfig config;
  config.carve = state.range(0) != 0;
  VolumetricFusion fusion(config);
  std::size_t k = 0;
  for (auto _ : state) {
    const std::size_t at = k++ % meshes.size();
    fusion.integrate(meshes[at], Eigen::Vector3d(0.25 * static_cast<double>(at), 0, 0));
  }
  state.counters["points"] = static_cast<double>(meshes[0].vertices.size());
  state.counters["MB"] = static_cast<double>(fusion.memoryBytes()) / 1e6;
}
BENCHMARK(volumetricIntegrate)->ArgName("carve")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void volumetricExtract(benchmark::State& state) {
  VolumetricFusion fusion({});
  const std::vector<Mesh> meshes = track(200);
  for (std::size_t k = 0; k < meshes.size(); ++k)
    fusion.integrate(meshes[k], Eigen::Vector3d(0.25 * static_cast<double>(k), 0, 0));
  std::size_t triangles = 0;
  for (auto _ : state) triangles = fusion.extract().triangles.size();
  state.counters["triangles"] = static_cast<double>(triangles);
}
BENCHMARK(volumetricExtract)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::fusion
