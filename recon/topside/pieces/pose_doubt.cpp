#include "recon/topside/pieces/pose_doubt.hpp"

#include <algorithm>

namespace fathom::topside {

const Matrix6d& PoseDoubt::nearest(std::uint32_t pair) const {
  const auto after = std::lower_bound(uncertain_.begin(), uncertain_.end(), pair,
                                      [](const auto& u, std::uint32_t p) { return u.pair < p; });
  if (after == uncertain_.begin()) return after->covariance;
  const auto before = after - 1;
  const bool later = after != uncertain_.end() && after->pair - pair < pair - before->pair;
  return (later ? after : before)->covariance;
}

std::vector<UncertainView> PoseDoubt::viewsOf(const std::vector<std::uint32_t>& pairs,
                                              const std::vector<SE3>& T_nav_cam,
                                              const std::vector<fusion::MeshFootprint>& footprints) const {
  std::vector<UncertainView> views;
  if (uncertain_.empty()) return views;
  for (const std::uint32_t pair : pairs)
    views.push_back({T_nav_cam[pair], nearest(pair), footprints[pair].box});
  return views;
}

void PoseDoubt::addKey(Hasher& hasher, std::uint32_t pair) const {
  if (uncertain_.empty()) return;
  const Matrix6d& covariance = nearest(pair);
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column <= row; ++column) hasher.add(covariance(row, column));
}

}  // namespace fathom::topside
