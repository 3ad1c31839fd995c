#include "sim/score/surface_score.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"

namespace fathom::sim {
namespace {

constexpr std::size_t kSamples = 100'000;          // of the distances
constexpr std::size_t kAlignmentSamples = 10'000;  // of the alignment

std::pair<std::int32_t, std::int32_t> planCellOf(const Eigen::Vector3d& p) {
  return {static_cast<std::int32_t>(std::floor(p.x() / kPlanCell)),
          static_cast<std::int32_t>(std::floor(p.y() / kPlanCell))};
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

double meanOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

// Mean of squared distances over the mesh's variances at the points of forSurface().
std::optional<double> overVariance(const Mesh& mesh, const std::vector<double>& distances) {
  if (mesh.sigma.empty()) return std::nullopt;
  constexpr double kLeastSigma = 1e-4;  // as the mesh's file resolves it [m]
  double sum = 0;
  std::size_t at = 0;
  forSurface(mesh, distances.size(), [&](const auto& t, double u, double v, const auto&) {
    const auto sigma = [&](int k) { return static_cast<double>(mesh.sigma[t[static_cast<std::size_t>(k)]]); };
    const double here = (1 - u - v) * sigma(0) + u * sigma(1) + v * sigma(2);
    const double ratio = distances[at++] / std::max(here, kLeastSigma);
    sum += ratio * ratio;
  });
  return sum / static_cast<double>(distances.size());
}

void sortMagnitudes(std::vector<double>& values) {
  for (double& v : values) v = std::abs(v);
  std::sort(values.begin(), values.end());
}

// Fraction of the true points within kComplete of the estimate after its motion.
double completeness(const Mesh& estimate, const SE3& motion, const Points& seen) {
  if (seen.empty()) return 0;
  const TruthSurface surface(estimate);
  const SE3 back = motion.inverse();
  std::vector<std::uint8_t> near(seen.size());
  tbb::parallel_for(std::size_t{0}, seen.size(), [&](std::size_t i) {
    near[i] = surface.nearest(back * seen[i]).distance <= SurfaceScore::kComplete ? 1 : 0;
  });
  return static_cast<double>(std::count(near.begin(), near.end(), 1)) / static_cast<double>(near.size());
}

}  // namespace

void forSurface(const Mesh& mesh, std::size_t count,
                const std::function<void(const std::array<std::uint32_t, 3>& triangle, double u, double v,
                                         const Eigen::Vector3d& point)>& visit) {
  std::vector<double> area_up_to;
  double total = 0;
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices[t[0]].cast<double>();
    total +=
        0.5 * (mesh.vertices[t[1]].cast<double>() - a).cross(mesh.vertices[t[2]].cast<double>() - a).norm();
    area_up_to.push_back(total);
  }
  if (!(total > 0)) return;
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
    visit(t, u, v,
          a + u * (mesh.vertices[t[1]].cast<double>() - a) + v * (mesh.vertices[t[2]].cast<double>() - a));
  }
}

Points sampleSurface(const Mesh& mesh, std::size_t count) {
  Points points;
  points.reserve(count);
  forSurface(mesh, count,
             [&](const auto&, double, double, const Eigen::Vector3d& p) { points.push_back(p); });
  return points;
}

VisibleSeafloor visibleSeafloor(const TruthSurface& truth, const Camera& camera,
                                const std::vector<SE3>& T_nav_cam) {
  constexpr int kAcross = 64, kDown = 48;  // rays a pose: 7 cm apart at 6 m
  std::vector<Eigen::Vector3d> rays;
  for (int row = 0; row < kDown; ++row) {
    for (int column = 0; column < kAcross; ++column) {
      rays.push_back(camera.ray(
          {(column + 0.5) / kAcross * camera.width - 0.5, (row + 0.5) / kDown * camera.height - 0.5}));
    }
  }
  // One of `every` hits is kept; `every` is odd, to have no factor in common with the rays of a row.
  const std::size_t every = (T_nav_cam.size() * rays.size() / kSamples) | 1U;
  VisibleSeafloor seen;
  std::size_t hits = 0;
  for (const SE3& pose : T_nav_cam) {
    for (const Eigen::Vector3d& ray : rays) {
      const auto hit = truth.castRay(pose.translation(), pose.rotation() * ray);
      if (!hit) continue;
      seen.cells.insert(planCellOf(*hit));
      if (hits++ % every == 0) seen.points.push_back(*hit);
    }
  }
  return seen;
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
        const auto cell = planCellOf(a + ab * i / steps + ac * j / steps);
        if (cell == last) continue;
        cells.insert(cell);
        last = cell;
      }
    }
  }
  return cells;
}

SurfaceScore scoreSurface(const Mesh& estimate, const TruthSurface& truth, const VisibleSeafloor& seen,
                          const SE3& start) {
  SurfaceScore score;
  const Points points = sampleSurface(estimate, kSamples);
  std::vector<double> distances = signedDistances(points, truth, SE3());
  score.rms_m = rootMeanSquare(distances);
  score.bias_m = meanOf(distances);
  score.squared_over_variance = overVariance(estimate, distances);
  sortMagnitudes(distances);
  score.p50_m = quantile(distances, 0.50);
  score.p95_m = quantile(distances, 0.95);
  score.p99_m = quantile(distances, 0.99);

  score.alignment = alignSurface(sampleSurface(estimate, kAlignmentSamples), truth, start);
  distances = signedDistances(points, truth, score.alignment);
  score.aligned_rms_m = rootMeanSquare(distances);
  score.aligned_bias_m = meanOf(distances);
  sortMagnitudes(distances);
  score.aligned_p95_m = quantile(distances, 0.95);

  const PlanCells covered = meshCells(estimate, score.alignment);
  std::size_t both = 0;
  for (const auto& cell : seen.cells) both += covered.count(cell);
  score.coverage =
      seen.cells.empty() ? 0.0 : static_cast<double>(both) / static_cast<double>(seen.cells.size());
  score.completeness = completeness(estimate, score.alignment, seen.points);
  return score;
}

}  // namespace fathom::sim
