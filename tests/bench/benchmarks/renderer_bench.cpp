// A full 1360 x 1024 photograph on one thread, from 2 m over a reef: the renderer, and beside it Embree alone
// with single rays, one view ray and two shadow rays a pixel without any shading. The renderer traces bundles
// of eight.
#include <benchmark/benchmark.h>
#include <oneapi/tbb/task_arena.h>

#include <vector>

#include "sim/sea/renderer.hpp"

namespace fathom::sim {
namespace {

const StereoRig kRig{Camera{1360, 1024, 1712, 1712, 680, 512, 0.136, 0.734, 0, 0, 0},
                     Camera{1360, 1024, 1712, 1712, 680, 512, 0.136, 0.734, 0, 0, 0},
                     SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0})};
const SE3 kPose = SE3::fromEuler(0.02, 0.03, 0.4, {0.5, 0.2, 18.0});

SE3 cameraInBody() {
  Eigen::Matrix3d r;
  r << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  return {r, Eigen::Vector3d::Zero()};
}

const SeaTerrain& reef() {
  static const SeaTerrain terrain([] {
    TerrainConfig config;
    config.size_north_m = config.size_east_m = 8.0;
    config.corals.density_per_m2 = 0.3;
    return config;
  }());
  return terrain;
}

void renderImage(benchmark::State& state) {
  const Renderer renderer(reef(), OpticsConfig(), kRig, cameraInBody());
  const auto side = static_cast<CameraSide>(state.range(0));
  std::vector<std::uint16_t> image(static_cast<std::size_t>(renderer.width(side) * renderer.height(side)));
  oneapi::tbb::task_arena one_thread(1);
  for (auto _ : state) one_thread.execute([&] { renderer.render(kPose, 0, side, 1, image.data()); });
  state.SetLabel(side == CameraSide::kLeft ? "left, Bayer" : "right, mono");
}
BENCHMARK(renderImage)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void renderEmbreeAlone(benchmark::State& state) {
  const SeaTerrain& terrain = reef();
  const SE3 T_nav_cam = kPose * cameraInBody();
  const Eigen::Vector3d strobes[] = {kPose * Eigen::Vector3d(0.75, 0, 0),
                                     kPose * Eigen::Vector3d(-0.75, 0, 0)};
  constexpr double kLift = 3e-4;  // [m]
  const Camera& camera = kRig.left;
  for (auto _ : state) {
    double sum = 0;
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const Eigen::Vector3d ray = T_nav_cam.rotation() * Eigen::Vector3d((x - camera.cx) / camera.fx,
                                                                           (y - camera.cy) / camera.fy, 1.0);
        const auto range = terrain.castRay(T_nav_cam.translation(), ray);
        if (!range) continue;
        const Eigen::Vector3d point = T_nav_cam.translation() + (*range - kLift) * ray.normalized();
        for (const Eigen::Vector3d& strobe : strobes)
          sum += terrain.castRay(strobe, point - strobe).value_or(0.0);
      }
    }
    benchmark::DoNotOptimize(sum);
  }
}
BENCHMARK(renderEmbreeAlone)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::sim
