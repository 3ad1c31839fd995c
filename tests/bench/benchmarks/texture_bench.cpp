#include <benchmark/benchmark.h>

#include <random>

#include "recon/surface/blend.hpp"
#include "recon/surface/chart_lattice.hpp"
#include "recon/surface/view_vote.hpp"
#include "tests/support/lattice_mesh.hpp"

// A leaf tile of a survey like reef-grid at full size: the seafloor 2 m below, a picture every 0.25 m, lines
// 0.7 m apart. "per_pair" is the time that falls on a pair where it brings 0.4 m2 of new seafloor.
namespace fathom::surface {
namespace {

constexpr double kEdge = 2.112, kTexel = 0.0012, kDepth = 2, kFace = 0.045;
constexpr double kAlong = 0.25, kLines = 0.7, kAcross = 1.7;
constexpr double kNewArea = 0.4;  // [m2] a pair

Camera fullCamera() {
  Camera camera;
  camera.width = 1360, camera.height = 1024;
  camera.fx = 1725, camera.fy = 1723, camera.cx = 687, camera.cy = 507;
  camera.k1 = 0.142, camera.k2 = 0.655, camera.p1 = 0.0021, camera.p2 = -0.0013;
  return camera;
}

RgbImage noise(const Camera& camera, unsigned seed) {
  RgbImage image{camera.width, camera.height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  std::mt19937 random(seed);
  for (auto& value : image.rgb) value = static_cast<std::uint8_t>(90 + random() % 64);
  return image;
}

// Waves a few centimetres high.
TileMesh seafloor(double low, double high) {
  TileMesh tile;
  const auto n = static_cast<int>(std::lround((high - low) / kFace));
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      const double north = low + (high - low) * i / n, east = low + (high - low) * j / n;
      const double depth = kDepth + 0.05 * std::sin(5 * north) * std::cos(4 * east);
      tile.mesh.vertices.push_back(
          Eigen::Vector3d(TileGrid::snap(north), TileGrid::snap(east), TileGrid::snap(depth)).cast<float>());
    }
  }
  tile.mesh.triangles = test::latticeTriangles(n + 1, n + 1);
  tile.shared.assign(tile.mesh.vertices.size(), 0);
  computeNormals(tile.mesh);
  return tile;
}

struct Scene {
  Camera camera = fullCamera();
  TileMesh tile = seafloor(0, kEdge);
  Mesh around = seafloor(-kEdge, 2 * kEdge).mesh;
  std::vector<std::shared_ptr<const BandImage>> images;
  std::vector<View> views;

  Scene() {
    for (unsigned k = 0; k < 4; ++k)
      images.push_back(std::make_shared<BandImage>(makeBands(noise(camera, k), {})));
    for (double east = -kAcross / 2; east < kEdge + kAcross / 2; east += kLines)
      for (double north = -kAcross / 2; north < kEdge + kAcross / 2; north += kAlong)
        views.push_back({static_cast<std::uint32_t>(views.size()),
                         SE3::fromEuler(0.03, -0.02, 1.57, {north, east, 0}),
                         {north - 1, east - 1, north + 1, east + 1}});
  }
  static const Scene& get() {
    static const Scene scene;
    return scene;
  }
};

void perPair(benchmark::State& state) {
  // Inverted rate of pairs, with pairs counted in thousands: milliseconds.
  state.counters["ms_per_pair"] =
      benchmark::Counter(kEdge * kEdge / kNewArea / 1e3,
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void textureBands(benchmark::State& state) {
  const RgbImage image = noise(fullCamera(), 1);
  for (auto _ : state) benchmark::DoNotOptimize(makeBands(image, {}));
}
BENCHMARK(textureBands)->Unit(benchmark::kMillisecond);

void textureBlend(benchmark::State& state) {
  const Scene& scene = Scene::get();
  BlendConfig config;
  config.mode = static_cast<BlendMode>(state.range(0));
  config.vote = config.mode == BlendMode::kBands;
  const ViewIndex index(scene.views);
  const auto places = index.meeting({0, 0, kEdge, kEdge});
  TextureBlender blender(scene.camera, config);
  Atlas atlas = makeAtlas(scene.tile, {kTexel, 4096, 4});
  BlendCounts counts;
  for (auto _ : state)
    counts = blender.blend(
        atlas, index, places, {&scene.around},
        TextureBlender::BandSource([&](std::uint32_t image) { return scene.images[image % 4]; }));
  perPair(state);
  state.counters["texels"] = static_cast<double>(counts.texels);
  state.counters["views"] = counts.views;
  state.counters["views_high"] = static_cast<double>(counts.samples) / static_cast<double>(counts.texels);
}
BENCHMARK(textureBlend)
    ->ArgName("mode")
    ->Arg(static_cast<int>(BlendMode::kBands))
    ->Arg(static_cast<int>(BlendMode::kAverage))
    ->Arg(static_cast<int>(BlendMode::kUnblended))
    ->Unit(benchmark::kMillisecond);

// Parts of it.
void textureLattice(benchmark::State& state) {
  const Atlas atlas = makeAtlas(Scene::get().tile, {kTexel, 4096, 4});
  for (auto _ : state) benchmark::DoNotOptimize(ChartLattice(atlas).texels);
  perPair(state);
}
BENCHMARK(textureLattice)->Unit(benchmark::kMillisecond);

void textureRasterise(benchmark::State& state) {
  const Atlas atlas = makeAtlas(Scene::get().tile, {kTexel, 4096, 4});
  std::vector<Texel> texels;
  for (auto _ : state)
    for (int row = 0; row < atlas.height; row += 64)
      rasterise(atlas, row, std::min(64, atlas.height - row), texels);
  perPair(state);
}
BENCHMARK(textureRasterise)->Unit(benchmark::kMillisecond);

void textureDepthBuffers(benchmark::State& state) {
  const Scene& scene = Scene::get();
  const Eigen::Vector3d origin(1, 1, 2);
  const Occluders occluders({&scene.around}, origin);
  DepthBuffer buffer;
  for (auto _ : state)
    for (const View& view : scene.views) buffer.draw(occluders, {scene.camera, view.T_nav_cam, origin});
  perPair(state);
}
BENCHMARK(textureDepthBuffers)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::surface
