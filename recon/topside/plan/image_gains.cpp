#include "recon/topside/plan/image_gains.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/SparseCholesky>
#include <cmath>
#include <optional>
#include <unordered_map>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::topside {
namespace {

constexpr float kSame = 0.01F;             // two vertices at the same place are no farther apart [m]
constexpr std::size_t kFewestPlaces = 15;  // of them, to compare two images
constexpr double kCoupleSigma = 0.03;      // of a couple's ratio, in logarithms: what the light model leaves
constexpr double kLeastSpread = 0.001;     // of gains

std::uint64_t groundCellOf(int x, int y) {
  return static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32 | static_cast<std::uint32_t>(y);
}
int step(float metres) {
  return static_cast<int>(std::floor(metres / kSame));
}

}  // namespace

std::optional<double> logBrightness(const Mesh& a, const Mesh& b) {
  std::unordered_multimap<std::uint64_t, std::uint32_t> cells;
  for (std::uint32_t k = 0; k < b.vertices.size(); ++k)
    cells.emplace(groundCellOf(step(b.vertices[k].x()), step(b.vertices[k].y())), k);
  std::vector<double> ratios;
  for (std::size_t k = 0; k < a.vertices.size(); ++k) {
    const Eigen::Vector3f& p = a.vertices[k];
    float nearest = kSame;
    std::optional<std::uint32_t> found;
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy) {
        const auto [begin, end] = cells.equal_range(groundCellOf(step(p.x()) + dx, step(p.y()) + dy));
        for (auto i = begin; i != end; ++i) {
          const float distance = (b.vertices[i->second] - p).norm();
          if (distance >= nearest) continue;
          nearest = distance;
          found = i->second;
        }
      }
    if (!found) continue;
    const double one = luminanceOf(a.colours[k]), other = luminanceOf(b.colours[*found]);
    constexpr double kDark = 0.005;  // of full scale: noise
    if (one > kDark && other > kDark) ratios.push_back(std::log(one / other));
  }
  if (ratios.size() < kFewestPlaces) return std::nullopt;
  return median(ratios);
}

std::vector<float> imageGains(const PreparedGroups& prepared, const std::vector<SE3>& T_nav_cam,
                              const std::vector<std::pair<std::uint32_t, std::uint32_t>>& joined) {
  const auto pairs = static_cast<std::uint32_t>(T_nav_cam.size());
  std::vector<Couple> couples;
  for (std::uint32_t k = 0; k + 1 < pairs; ++k) couples.push_back({k, k + 1, {}});
  for (const auto& [a, b] : joined) couples.push_back({a, b, {}});
  const auto placed = [&](std::uint32_t k) {
    Mesh mesh;
    if (prepared.facts()[k].has_mesh) mesh = prepared.mesh(k);
    transform(mesh, T_nav_cam[k]);
    if (mesh.colours.empty()) mesh.vertices.clear();
    return mesh;
  };
  oneapi::tbb::parallel_for(std::size_t{0}, couples.size(), [&](std::size_t k) {
    couples[k].log_ratio = logBrightness(placed(couples[k].a), placed(couples[k].b));
  });
  return gainsOf(pairs, couples);
}

std::vector<float> gainsOf(std::size_t pairs, const std::vector<Couple>& couples) {
  std::vector<double> sizes;
  for (const Couple& couple : couples)
    if (couple.log_ratio) sizes.push_back(std::abs(*couple.log_ratio));
  if (sizes.empty()) return std::vector<float>(pairs, 1.0F);
  // Gains spread as much as couples' ratios do beyond what the light model leaves: nothing, mostly.
  constexpr double kDeviations = 1.4826;  // of a normal's, in its median
  const double seen = kDeviations * median(sizes);
  const double spread =
      std::max(kLeastSpread, std::sqrt(std::max(0.0, (seen * seen - kCoupleSigma * kCoupleSigma) / 2)));
  const auto n = static_cast<Eigen::Index>(pairs);
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (int k = 0; k < n; ++k) entries.emplace_back(k, k, 1 / (spread * spread));
  constexpr double kWeight = 1 / (kCoupleSigma * kCoupleSigma);
  for (const Couple& couple : couples) {
    if (!couple.log_ratio) continue;
    const auto a = static_cast<int>(couple.a), b = static_cast<int>(couple.b);
    entries.emplace_back(a, a, kWeight);
    entries.emplace_back(b, b, kWeight);
    entries.emplace_back(a, b, -kWeight);
    entries.emplace_back(b, a, -kWeight);
    right(a) += kWeight * *couple.log_ratio;
    right(b) -= kWeight * *couple.log_ratio;
  }
  Eigen::SparseMatrix<double> normal(n, n);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::VectorXd gains =
      Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(normal).solve(right).array().exp();
  return {gains.data(), gains.data() + gains.size()};
}

}  // namespace fathom::topside
