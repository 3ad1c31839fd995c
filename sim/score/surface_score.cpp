#include "sim/score/surface_score.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace fathom::sim {
namespace {

constexpr std::size_t kSamples = 100'000;          // of the distances
constexpr std::size_t kAlignmentSamples = 10'000;  // of the alignment

std::pair<std::int32_t, std::int32_t> cellOf(const Eigen::Vector3d& p) {
  return {static_cast<std::int32_t>(std::floor(p.x() / kPlanCell)),
          static_cast<std::int32_t>(std::floor(p.y() / kPlanCell))};
}

double percentile(const std::vector<double>& sorted, double fraction) {
  const double place = fraction * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (place - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

// Signed distances: positive above the true surface.
std::vector<double> signedDistances(const Points& points, const TruthSurface& truth, const SE3& motion) {
  std::vector<double> distances(points.size());
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    const Eigen::Vector3d p = motion * points[i];
    const TruthSurface::Nearest nearest = truth.nearest(p);
    distances[i] = nearest.point.z() >= p.z() ? nearest.distance : -nearest.distance;
  });
  return distances;
}

double rootMeanSquare(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

}  // namespace

Points sampleSurface(const Mesh& mesh, std::size_t count) {
  std::vector<double> area_up_to;
  double total = 0;
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices[t[0]].cast<double>();
    total +=
        0.5 * (mesh.vertices[t[1]].cast<double>() - a).cross(mesh.vertices[t[2]].cast<double>() - a).norm();
    area_up_to.push_back(total);
  }
  Points points;
  if (!(total > 0)) return points;
  points.reserve(count);
  // Equal steps along the summed area choose the triangle; the R2 sequence (Roberts 2018) the place in it.
  constexpr double kR2First = 0.7548776662466927, kR2Second = 0.5698402909980532;
  std::size_t triangle = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double area = (static_cast<double>(i) + 0.5) / static_cast<double>(count) * total;
    while (area_up_to[triangle] < area) ++triangle;
    const double n = static_cast<double>(i + 1);
    double u = n * kR2First - std::floor(n * kR2First), v = n * kR2Second - std::floor(n * kR2Second);
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    const auto& t = mesh.triangles[triangle];
    const Eigen::Vector3d a = mesh.vertices[t[0]].cast<double>();
    points.push_back(a + u * (mesh.vertices[t[1]].cast<double>() - a) +
                     v * (mesh.vertices[t[2]].cast<double>() - a));
  }
  return points;
}

PlanCells seenCells(const TruthSurface& truth, const Camera& camera, const std::vector<SE3>& T_nav_cam) {
  constexpr int kAcross = 64, kDown = 48;  // rays a pose: 7 cm apart at 6 m
  std::vector<Eigen::Vector3d> rays;
  for (int row = 0; row < kDown; ++row) {
    for (int column = 0; column < kAcross; ++column) {
      rays.push_back(camera.ray(
          {(column + 0.5) / kAcross * camera.width - 0.5, (row + 0.5) / kDown * camera.height - 0.5}));
    }
  }
  PlanCells cells;
  for (const SE3& pose : T_nav_cam) {
    for (const Eigen::Vector3d& ray : rays) {
      if (const auto hit = truth.castRay(pose.translation(), pose.rotation() * ray))
        cells.insert(cellOf(*hit));
    }
  }
  return cells;
}

PlanCells meshCells(const Mesh& mesh, const SE3& motion) {
  constexpr double kStep = 0.5 * kPlanCell;  // between the points laid over a triangle [m]
  constexpr int kMostSteps = 2000;           // a triangle of 100 m
  PlanCells cells;
  std::pair<std::int32_t, std::int32_t> last{INT32_MAX, INT32_MAX};
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3d a = motion * mesh.vertices[t[0]].cast<double>();
    const Eigen::Vector3d ab = motion * mesh.vertices[t[1]].cast<double>() - a;
    const Eigen::Vector3d ac = motion * mesh.vertices[t[2]].cast<double>() - a;
    const double longest = std::max({ab.norm(), ac.norm(), (ab - ac).norm()});
    const int steps = std::clamp(static_cast<int>(std::ceil(longest / kStep)), 1, kMostSteps);
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; i + j <= steps; ++j) {
        const auto cell = cellOf(a + ab * i / steps + ac * j / steps);
        if (cell == last) continue;
        cells.insert(cell);
        last = cell;
      }
    }
  }
  return cells;
}

SurfaceScore scoreSurface(const Mesh& estimate, const TruthSurface& truth, const PlanCells& seen,
                          const SE3& start) {
  SurfaceScore score;
  const Points points = sampleSurface(estimate, kSamples);
  std::vector<double> distances = signedDistances(points, truth, SE3());
  score.rms_m = rootMeanSquare(distances);
  for (const double d : distances) score.bias_m += d / static_cast<double>(distances.size());
  for (double& d : distances) d = std::abs(d);
  std::sort(distances.begin(), distances.end());
  score.p50_m = percentile(distances, 0.50);
  score.p95_m = percentile(distances, 0.95);
  score.p99_m = percentile(distances, 0.99);

  const SE3 motion = alignSurface(sampleSurface(estimate, kAlignmentSamples), truth, start);
  score.aligned_rms_m = rootMeanSquare(signedDistances(points, truth, motion));

  const PlanCells covered = meshCells(estimate, motion);
  std::size_t both = 0;
  for (const auto& cell : seen) both += covered.count(cell);
  score.coverage = seen.empty() ? 0.0 : static_cast<double>(both) / static_cast<double>(seen.size());
  return score;
}

}  // namespace fathom::sim
