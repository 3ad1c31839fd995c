#include "recon/slam/held_fixes.hpp"

namespace fathom::slam {

void HeldFixes::Sums::add(const Eigen::Vector2d& place, double sigma) {
  const double w = 1 / (sigma * sigma);
  weight += w;
  sum += w * place;
  squares += w * place.squaredNorm();
}

Eigen::Vector2d HeldFixes::middle(double shared) const {
  const double weight = by_usbl_.weight / (1 + by_usbl_.weight * shared * shared),
               all = alone_.weight + weight;
  return all > 0 ? (alone_.sum + weight * by_usbl_.middle()) / all : alone_.sum;
}

Eigen::Matrix2d HeldFixes::errorOf(const Eigen::Vector2d& from_middle, double scale, double direction,
                                   double usbl_turn) const {
  const double seen = by_usbl_.aboutMiddle(), turned = seen / (1 + seen * usbl_turn * usbl_turn);
  const auto left = [](double variance, double information) {
    return variance / (1 + variance * information);
  };
  const Eigen::Vector2d across(-from_middle.y(), from_middle.x());
  return left(scale, alone_.aboutMiddle() + seen) * from_middle * from_middle.transpose() +
         left(direction, alone_.aboutMiddle() + turned) * across * across.transpose();
}

}  // namespace fathom::slam
