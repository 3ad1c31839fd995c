#include "tests/bench/fusion_peer/scans.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "recon/geometry/mesh_io.hpp"
#include "recon/stereo/delaunay.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "tests/bench/stereo_truth.hpp"

namespace fathom::fusion {
namespace {

double seafloor(double n, double e) {
  return 2.0 + 0.15 * std::sin(1.9 * n) * std::cos(1.6 * e) + 0.03 * std::sin(7 * n + 5 * e);
}

// Depth along the optical axis of what a ray (x, y, 1) from the camera meets, by fixed-point steps.
double depthAlong(const SE3& T_nav_cam, const Eigen::Vector3d& ray) {
  const Eigen::Vector3d from = T_nav_cam.translation(), direction = T_nav_cam.rotation() * ray;
  double depth = 2;
  for (int k = 0; k < 60; ++k) {
    const Eigen::Vector3d p = from + depth * direction;
    depth += 0.7 * (seafloor(p.x(), p.y()) - p.z()) / direction.z();
  }
  return depth;
}

Mesh seafloorMesh(double low_n, double high_n, double low_e, double high_e) {
  constexpr double kStep = 0.01;  // [m]: chords are less than 0.1 mm off
  const auto rows = static_cast<std::uint32_t>((high_n - low_n) / kStep);
  const auto columns = static_cast<std::uint32_t>((high_e - low_e) / kStep);
  Mesh mesh;
  for (std::uint32_t i = 0; i < rows; ++i)
    for (std::uint32_t j = 0; j < columns; ++j) {
      const double n = low_n + i * kStep, e = low_e + j * kStep;
      mesh.vertices.emplace_back(n, e, seafloor(n, e));
      if (i == 0 || j == 0) continue;
      const std::uint32_t d = i * columns + j, b = d - columns, a = b - 1, c = d - 1;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  return mesh;
}

}  // namespace

ScanSet scansOf(const std::filesystem::path& folder, std::size_t first, std::size_t count) {
  const stereo::TrueMission mission(folder);
  ScanSet set;
  set.name = folder.filename().string();
  set.camera = mission.rig().left;
  set.truth = std::make_shared<sim::TruthSurface>(readPly(folder / "truth" / "terrain.ply"));
  stereo::SparseStereo stereo(mission.rig(), {});
  for (std::size_t k = first; k < std::min(first + count, mission.pairs()); ++k) {
    const stereo::TruePair pair = mission.pair(k);
    const auto view = [](const cv::Mat& image) {
      return ImageView{image.data, image.cols, image.rows, image.step, PixelFormat::kMono, 8};
    };
    const stereo::StereoResult& found = stereo.process(view(pair.left), view(pair.right), pair.plane);
    if (found.triangles.empty()) continue;
    Scan scan{stereo::toMesh(found, view(pair.left)), {}, pair.T_nav_cam};
    scan.oracle = scan.mesh;
    for (std::size_t v = 0; v < found.points.size(); ++v)
      if (const auto p = mission.pointAt(pair, found.points[v].left.cast<double>()))
        scan.oracle.vertices[v] = p->cast<float>();
    transform(scan.mesh, scan.T_nav_cam);
    transform(scan.oracle, scan.T_nav_cam);
    set.scans.push_back(std::move(scan));
  }
  return set;
}

ScanSet analyticScans(std::size_t count) {
  constexpr std::size_t kPerLine = 40;
  constexpr int kColumns = 30, kRows = 23;
  constexpr double kPerSquare = 0.0015;  // sigma over the square of the depth [1/m]
  ScanSet set;
  set.name = "known surface";
  set.camera = {.width = 1360, .height = 1024, .fx = 1700, .fy = 1700, .cx = 679.5, .cy = 511.5};
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0, 1);
  std::uniform_real_distribution<double> jitter(-0.4, 0.4);
  stereo::Delaunay delaunay;
  for (std::size_t k = 0; k < count; ++k) {
    const double north = 0.25 * static_cast<double>(k % kPerLine),
                 east = 0.7 * static_cast<double>(k / kPerLine);
    const Eigen::Quaterniond tilt = Eigen::AngleAxisd(0.05 * normal(random), Eigen::Vector3d::UnitX()) *
                                    Eigen::AngleAxisd(0.05 * normal(random), Eigen::Vector3d::UnitY()) *
                                    Eigen::Quaterniond::Identity();
    Scan scan{{}, {}, SE3(tilt, {north, east, 0.0})};
    std::vector<stereo::Delaunay::Point> pixels;
    for (int r = 0; r < kRows; ++r) {
      for (int c = 0; c < kColumns; ++c) {
        const Eigen::Vector2d pixel((c + 0.5 + jitter(random)) * set.camera.width / kColumns,
                                    (r + 0.5 + jitter(random)) * set.camera.height / kRows);
        const Eigen::Vector2d whole = pixel.array().floor();
        pixels.push_back({static_cast<std::int32_t>(whole.x()), static_cast<std::int32_t>(whole.y())});
        const Eigen::Vector3d ray = set.camera.ray(whole);
        const double depth = depthAlong(scan.T_nav_cam, ray);
        const double sigma = kPerSquare * depth * depth;
        scan.oracle.vertices.push_back((scan.T_nav_cam * (ray * depth)).cast<float>());
        scan.mesh.vertices.push_back(
            (scan.T_nav_cam * (ray * (depth + sigma * normal(random)))).cast<float>());
        scan.mesh.sigma.push_back(static_cast<float>(sigma));
      }
    }
    scan.mesh.colours.assign(scan.mesh.vertices.size(), Rgb{90, 120, 60});
    // Counter-clockwise for the camera, whose image has y down.
    for (const auto& [a, b, c] : delaunay.triangulate(pixels)) scan.mesh.triangles.push_back({a, c, b});
    scan.oracle.sigma = scan.mesh.sigma;
    scan.oracle.colours = scan.mesh.colours;
    scan.oracle.triangles = scan.mesh.triangles;
    set.scans.push_back(std::move(scan));
  }
  const double lines = static_cast<double>((count + kPerLine - 1) / kPerLine);
  set.truth = std::make_shared<sim::TruthSurface>(
      seafloorMesh(-2, 0.25 * static_cast<double>(std::min(count, kPerLine)) + 2, -2, 0.7 * lines + 2));
  return set;
}

}  // namespace fathom::fusion
