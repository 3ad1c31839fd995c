#include "recon/topside/localise/crossovers.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

namespace fathom::topside {
namespace {

// Pairs closer in time overlap because the vehicle is slow, not because it came back [ns].
constexpr std::int64_t kComeBack = 60'000'000'000;

}  // namespace

std::vector<bool> likelyCrossovers(const std::vector<FusedPair>& pairs) {
  std::vector<bool> crossover(pairs.size(), false);
  double widest = 0.1;
  for (const FusedPair& p : pairs) widest = std::max(widest, p.footprint_radius);
  // Squares so large that footprints which overlap are in the same or in touching ones.
  const double square = 2 * widest;
  const auto squareOf = [&](const FusedPair& p) {
    const Eigen::Vector3d at = p.T_nav_cam.translation();
    return std::pair{static_cast<long>(std::floor(at.x() / square)),
                     static_cast<long>(std::floor(at.y() / square))};
  };
  std::map<std::pair<long, long>, std::vector<std::size_t>> squares;
  for (std::size_t k = 0; k < pairs.size(); ++k)
    if (pairs[k].footprint_radius > 0) squares[squareOf(pairs[k])].push_back(k);
  const auto overlap = [&](const FusedPair& a, const FusedPair& b) {
    const double apart = (a.T_nav_cam.translation() - b.T_nav_cam.translation()).head<2>().norm();
    return std::abs(a.pair.utc_ns - b.pair.utc_ns) > kComeBack &&
           apart < a.footprint_radius + b.footprint_radius;
  };
  for (const auto& [at, members] : squares) {
    for (const std::size_t k : members) {
      for (long dn = -1; dn <= 1 && !crossover[k]; ++dn) {
        for (long de = -1; de <= 1 && !crossover[k]; ++de) {
          const auto near = squares.find({at.first + dn, at.second + de});
          if (near == squares.end()) continue;
          crossover[k] = std::any_of(near->second.begin(), near->second.end(),
                                     [&](std::size_t other) { return overlap(pairs[k], pairs[other]); });
        }
      }
    }
  }
  return crossover;
}

}  // namespace fathom::topside
