// Volumetric fusion of the same local meshes with Fathom and with Open3D's scalable TSDF: time of one thread
// and distance to the true surface, and the same fusion of the same points where they truly are (the oracle).
// Open3D takes depth images, which are drawn from the meshes beforehand.
#include <time.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <utility>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "sim/score/surface_score.hpp"
#include "tests/bench/fusion_peer/open3d_peer.hpp"
#include "tests/bench/fusion_peer/scans.hpp"

namespace fathom::fusion {
namespace {

constexpr std::size_t kSamples = 100'000;  // of a surface

double cpuMs() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

struct Errors {
  double rms = 0, median = 0, p95 = 0, bias = 0;  // [m]; bias is positive above the surface
};

Errors errorsOf(const Mesh& mesh, const sim::TruthSurface& truth) {
  const std::vector<Eigen::Vector3d> points = sim::sampleSurface(mesh, kSamples);
  std::vector<double> distances;
  Errors out;
  for (const Eigen::Vector3d& p : points) {
    const sim::TruthSurface::Nearest nearest = truth.nearest(p);
    const double share = nearest.distance / static_cast<double>(points.size());
    out.bias += nearest.point.z() >= p.z() ? share : -share;
    out.rms += nearest.distance * share;
    distances.push_back(nearest.distance);
  }
  if (distances.empty()) return out;
  out.rms = std::sqrt(out.rms);
  std::sort(distances.begin(), distances.end());
  out.median = distances[distances.size() / 2];
  out.p95 = distances[distances.size() * 95 / 100];
  return out;
}

// Root mean square of error over stated sigma, and of sigma [m].
std::pair<double, double> honestyOf(const Mesh& mesh, const sim::TruthSurface& truth) {
  double ratio = 0, sigma = 0;
  const auto count = static_cast<double>(mesh.vertices.size());
  for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
    const double s = static_cast<double>(mesh.sigma[k]);
    const double d = truth.nearest(mesh.vertices[k].cast<double>()).distance;
    ratio += d * d / (s * s) / count;
    sigma += s * s / count;
  }
  return {std::sqrt(ratio), std::sqrt(sigma)};
}

double areaOf(const Mesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    sum += 0.5 * static_cast<double>(
                     (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  return sum;
}

void print(const std::string& name, double integrate_ms, double extract_ms, const Mesh& mesh,
           const sim::TruthSurface& truth) {
  const Errors e = errorsOf(mesh, truth);
  std::printf("  %-28s %8.3f %8.3f %9.2f %9.2f %9.2f %9.2f %9.1f\n", name.c_str(), integrate_ms, extract_ms,
              1e3 * e.rms, 1e3 * e.median, 1e3 * e.p95, 1e3 * e.bias, areaOf(mesh));
}

double fuseAndPrint(const std::string& name, const ScanSet& set, Mesh Scan::*which,
                    const VolumetricConfig& config, int repeats) {
  double best = INFINITY, best_extract = INFINITY;
  Mesh mesh;
  for (int k = 0; k < repeats; ++k) {
    VolumetricFusion fusion(config);
    const double begin = cpuMs();
    for (const Scan& scan : set.scans) fusion.integrate(scan.*which, scan.T_nav_cam.translation());
    best = std::min(best, (cpuMs() - begin) / static_cast<double>(set.scans.size()));
    const double extract = cpuMs();
    mesh = fusion.extract();
    best_extract = std::min(best_extract, (cpuMs() - extract) / static_cast<double>(set.scans.size()));
  }
  print(name, best, best_extract, mesh, *set.truth);
  const auto [ratio, sigma] = honestyOf(mesh, *set.truth);
  std::printf("  %-28s sigma %.2f mm, error / sigma %.2f\n", "", 1e3 * sigma, ratio);
  return best + best_extract;
}

void compare(const ScanSet& set, const VolumetricConfig& config, int repeats) {
  const auto count = static_cast<double>(set.scans.size());
  double points = 0, triangles = 0;
  for (const Scan& scan : set.scans) {
    points += static_cast<double>(scan.mesh.vertices.size()) / count;
    triangles += static_cast<double>(scan.mesh.triangles.size()) / count;
  }
  std::printf("%s: %zu meshes of %.0f points, %.0f triangles; voxels of %.1f mm, band %.0f mm; one thread\n",
              set.name.c_str(), set.scans.size(), points, triangles, 1e3 * config.voxel,
              1e3 * config.truncation);
  std::printf("  %-28s %8s %8s %9s %9s %9s %9s %9s\n", "", "fuse ms", "mesh ms", "rms mm", "median", "95 %",
              "bias", "area m2");
  const double own = fuseAndPrint("Fathom", set, &Scan::mesh, config, repeats);
  VolumetricConfig plain = config;
  plain.carve = false;
  fuseAndPrint("Fathom without carving", set, &Scan::mesh, plain, repeats);
  fuseAndPrint("Fathom, true depths", set, &Scan::oracle, config, 1);
#ifdef FATHOM_HAVE_OPEN3D
  for (const double factor : {0.25, 0.125}) {
    std::vector<DepthImage> images;
    for (const Scan& scan : set.scans)
      images.push_back(drawDepth(scan.mesh, scan.T_nav_cam, set.camera, factor));
    PeerRun best;
    for (int k = 0; k < repeats; ++k) {
      PeerRun run = fuseWithOpen3d(images, config.voxel, config.truncation);
      if (k == 0 || run.integrate_ms < best.integrate_ms) best = std::move(run);
    }
    const std::string name =
        "Open3D, " + std::to_string(images[0].camera.width) + " x " + std::to_string(images[0].camera.height);
    print(name, best.integrate_ms, best.extract_ms / count, best.mesh, *set.truth);
    std::printf("  %-28s %8.2f times Fathom's time\n", "",
                (best.integrate_ms + best.extract_ms / count) / own);
  }
#else
  static_cast<void>(own);
  std::printf("  built without Open3D\n");
#endif
}

}  // namespace
}  // namespace fathom::fusion

int main(int argc, char** argv) {
  CLI::App app("Volumetric fusion of the same meshes with Fathom and with Open3D");
  std::vector<std::filesystem::path> missions;
  std::size_t first = 0, pairs = 80;
  int repeats = 3;
  fathom::fusion::VolumetricConfig config;
  app.add_option("missions", missions, "simulated mission folders; none: the known surface alone");
  app.add_option("--first", first, "pair of each mission to begin with");
  app.add_option("--pairs", pairs, "of each")->check(CLI::Range(1, 100000));
  app.add_option("--repeats", repeats, "of each run; the fastest counts")->check(CLI::Range(1, 100));
  app.add_option("--voxel", config.voxel, "[m]");
  app.add_option("--truncation", config.truncation, "[m]");
  if (const auto code = fathom::parseCommandLine("report_fusion_peer", app, argc, argv)) return *code;
  return fathom::runTool("report_fusion_peer", [&]() -> int {
    using namespace fathom::fusion;
    compare(analyticScans(pairs), config, repeats);
    for (const auto& mission : missions) compare(scansOf(mission, first, pairs), config, repeats);
    return fathom::kExitSuccess;
  });
}
