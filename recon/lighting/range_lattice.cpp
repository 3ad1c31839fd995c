#include "recon/lighting/range_lattice.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>

namespace fathom::lighting {
namespace {

constexpr float kMaxRange = 50.0F;  // [m]: no strobe reaches there
constexpr int kColumns = RangeLattice::kColumns, kRows = RangeLattice::kRows;

bool known(float range) {
  return std::isfinite(range) && range > 0;
}

}  // namespace

float RangeLattice::at(float u, float v) const {
  const float x = std::clamp(u, 0.0F, 1.0F) * (kColumns - 1), y = std::clamp(v, 0.0F, 1.0F) * (kRows - 1);
  const int i = std::min(static_cast<int>(x), kColumns - 2), j = std::min(static_cast<int>(y), kRows - 2);
  const float s = x - static_cast<float>(i), t = y - static_cast<float>(j);
  const float* p = path.data() + j * kColumns + i;
  if (!known(p[0]) || !known(p[1]) || !known(p[kColumns]) || !known(p[kColumns + 1])) return 0;
  return (1 - t) * ((1 - s) * p[0] + s * p[1]) + t * ((1 - s) * p[kColumns] + s * p[kColumns + 1]);
}

RangeLattice::Ground RangeLattice::groundAt(float u, float v) const {
  const float x = std::clamp(u, 0.0F, 1.0F) * (kColumns - 1), y = std::clamp(v, 0.0F, 1.0F) * (kRows - 1);
  const int i = std::min(static_cast<int>(x), kColumns - 2), j = std::min(static_cast<int>(y), kRows - 2);
  const float s = x - static_cast<float>(i), t = y - static_cast<float>(j);
  const Ground* g = ground.data() + j * kColumns + i;
  const auto mix = [&](Eigen::Vector3f Ground::*of) -> Eigen::Vector3f {
    return (1 - t) * ((1 - s) * g[0].*of + s * g[1].*of) +
           t * ((1 - s) * g[kColumns].*of + s * g[kColumns + 1].*of);
  };
  return {mix(&Ground::point), mix(&Ground::normal).normalized()};
}

RangeMaker::RangeMaker(const Camera& camera) : camera_(camera) {
  for (int j = 0; j < kRows; ++j)
    for (int i = 0; i < kColumns; ++i) {
      const Eigen::Vector2d pixel(i * (camera.width - 1.0) / (kColumns - 1),
                                  j * (camera.height - 1.0) / (kRows - 1));
      rays_[static_cast<std::size_t>(j * kColumns + i)] = camera.ray(pixel).normalized().cast<float>();
    }
}

void RangeMaker::fromPlane(const Eigen::Vector3d& normal, double distance, RangeLattice& out) const {
  const Eigen::Vector3f n = normal.normalized().cast<float>();
  for (std::size_t k = 0; k < rays_.size(); ++k) {
    const float range = static_cast<float>(distance) / n.dot(rays_[k]);
    out.path[k] = known(range) && range <= kMaxRange ? range : 0.0F;
  }
  findGround(out);
}

void RangeMaker::findGround(RangeLattice& lattice) const {
  const auto at = [](int i, int j) { return static_cast<std::size_t>(j * kColumns + i); };
  for (std::size_t k = 0; k < rays_.size(); ++k) lattice.ground[k].point = lattice.path[k] * rays_[k];
  for (int j = 0; j < kRows; ++j)
    for (int i = 0; i < kColumns; ++i) {
      const auto along = [&](std::size_t a, std::size_t b) -> Eigen::Vector3f {
        if (!known(lattice.path[a]) || !known(lattice.path[b])) return Eigen::Vector3f::Zero();
        return lattice.ground[b].point - lattice.ground[a].point;
      };
      const Eigen::Vector3f right = along(at(std::max(i - 1, 0), j), at(std::min(i + 1, kColumns - 1), j));
      const Eigen::Vector3f down = along(at(i, std::max(j - 1, 0)), at(i, std::min(j + 1, kRows - 1)));
      const Eigen::Vector3f across = down.cross(right);
      const float length = across.norm();
      lattice.ground[at(i, j)].normal =
          length > 0 ? Eigen::Vector3f(across / length) : Eigen::Vector3f(-Eigen::Vector3f::UnitZ());
    }
}

void RangeMaker::bendTo(std::span<const Eigen::Vector3f> points, RangeLattice& lattice) const {
  constexpr int kReach = 2;         // nodes about a point that it bends
  constexpr float kSpread = 0.25F;  // weight of a node's neighbours beside one point 1 m off; the noise of
                                    // stereo, and so of slopes, grows with the range
  constexpr int kSweeps = 40;       // Gauss-Seidel, there and back: a value crosses the lattice in one
  std::array<float, kColumns * kRows> sums{}, weights{}, bends{};
  float sum = 0, count = 0;
  for (const Eigen::Vector3f& point : points) {
    if (!point.allFinite() || !(point.z() > 0)) continue;
    const Eigen::Vector2d pixel = camera_.project(point.cast<double>());
    const double u = pixel.x() / (camera_.width - 1.0), v = pixel.y() / (camera_.height - 1.0);
    if (!(u >= 0 && u <= 1 && v >= 0 && v <= 1)) continue;
    const float expected = lattice.at(static_cast<float>(u), static_cast<float>(v));
    if (!known(expected)) continue;
    const float ratio = std::log(point.norm() / expected);
    sum += ratio;
    count += 1;
    const float x = static_cast<float>(u) * (kColumns - 1), y = static_cast<float>(v) * (kRows - 1);
    const int i0 = static_cast<int>(std::lround(x)), j0 = static_cast<int>(std::lround(y));
    for (int j = std::max(j0 - kReach, 0); j <= std::min(j0 + kReach, kRows - 1); ++j)
      for (int i = std::max(i0 - kReach, 0); i <= std::min(i0 + kReach, kColumns - 1); ++i) {
        const float dx = static_cast<float>(i) - x, dy = static_cast<float>(j) - y;
        const float weight = std::exp(-2 * (dx * dx + dy * dy));
        const auto k = static_cast<std::size_t>(j * kColumns + i);
        sums[k] += weight * ratio;
        weights[k] += weight;
      }
  }
  if (count == 0) return;
  bends.fill(sum / count);
  const auto relax = [&](int i, int j) {
    const auto k = static_cast<std::size_t>(j * kColumns + i);
    float around = 0, neighbours = 0;
    const auto addNeighbour = [&](bool there, std::size_t n) {
      if (there) around += bends[n], neighbours += 1;
    };
    addNeighbour(i > 0, k - 1);
    addNeighbour(i + 1 < kColumns, k + 1);
    addNeighbour(j > 0, k - kColumns);
    addNeighbour(j + 1 < kRows, k + kColumns);
    const float range = known(lattice.path[k]) ? lattice.path[k] : 1, spread = kSpread * range * range;
    bends[k] = (sums[k] + spread * around / neighbours) / (weights[k] + spread);
  };
  for (int sweep = 0; sweep < kSweeps; ++sweep)
    for (int k = 0; k < kColumns * kRows; ++k) {
      const int n = sweep % 2 == 0 ? k : kColumns * kRows - 1 - k;
      relax(n % kColumns, n / kColumns);
    }
  for (std::size_t k = 0; k < bends.size(); ++k)
    if (known(lattice.path[k])) lattice.path[k] *= std::exp(bends[k]);
  findGround(lattice);
}

}  // namespace fathom::lighting
