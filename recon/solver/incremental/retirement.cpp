#include "recon/solver/incremental/retirement.hpp"

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <limits>

#include "recon/geometry/symmetric_eigen.hpp"

namespace fathom::slam {
namespace {

// Information below which a direction counts as not measured [1/m^2, 1/rad^2]: a deviation of 3 km.
constexpr double kUnmeasured = 1e-7;
// A shift is a straight line however long, a turn only while it is small.
constexpr double kStraight_m = 30, kStraight_rad = 0.05;
constexpr int kFits = 4;  // Gauss-Newton steps to where a link's measurements are satisfied; two are enough
constexpr int kShareRounds = 12;  // of the fixed point for shares
constexpr double kLeastShare = 1e-3;

// (A^-1 + B^-1)^-1 = A - A (A + B)^-1 A, which exists for singular ones too.
Matrix6d parallelSum(const Matrix6d& a, const Matrix6d& b) {
  constexpr double kRounding = 1e-15;
  const Matrix6d sum = a + b + kRounding * (a + b).trace() * Matrix6d::Identity();
  const Matrix6d p = a - a * sum.ldlt().solve(a);
  return 0.5 * (p + p.transpose());
}

// Shares of the strongest link's information for the others. In units of it, link i has the eigenvalues g,
// and a share s leaves s g / (s + g) of what all of it would, g / (1 + g). The sum over i and g of the
// logarithms of what is left is greatest where s_i is in proportion to sum g / (s_i + g).
struct Division {
  double loss = 0;  // of information, in nats
  std::array<double, kMostLinks> share{};
};

Division divide(std::span<const StarLink> links, std::size_t root) {
  std::array<Vector6d, kMostLinks> g;
  const Matrix6d unit = links[root].information + kUnmeasured * Matrix6d::Identity();
  Division d;
  for (std::size_t i = 0; i < links.size(); ++i) {
    d.share[i] = i == root ? 0 : 1.0 / static_cast<double>(links.size() - 1);
    if (i != root) g[i] = relativeEigenvalues(links[i].information, unit).cwiseMax(0);
  }
  for (int round = 0; round < kShareRounds; ++round) {
    double sum = 0;
    for (std::size_t i = 0; i < links.size(); ++i) {
      if (i == root) continue;
      d.share[i] = std::max(kLeastShare, (g[i].array() / (d.share[i] + g[i].array())).sum());
      sum += d.share[i];
    }
    for (double& share : d.share) share /= sum;
  }
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (i != root)
      d.loss += 0.5 * ((d.share[i] + g[i].array()) / (d.share[i] * (1 + g[i].array()))).log().sum();
  }
  return d;
}

// The Gauss-Newton step, in directions with enough information for a straight line. Where there is next to
// none (two depths, for the tilt between them), a millimetre would turn the pose by any angle; there the
// present pose is kept.
Vector6d firmStep(const Matrix6d& information, const Vector6d& gradient) {
  Vector6d unit;
  unit << Eigen::Vector3d::Constant(kStraight_m), Eigen::Vector3d::Constant(kStraight_rad);
  const SymmetricEigen<6> known =
      symmetricEigen(Matrix6d(unit.asDiagonal() * information * unit.asDiagonal()));
  Vector6d along = known.vectors.transpose() * unit.cwiseProduct(gradient);
  for (int i = 0; i < 6; ++i) along(i) = known.values(i) >= 1 ? along(i) / known.values(i) : 0;
  return unit.cwiseProduct(known.vectors * along);
}

}  // namespace

StarLink starLink(std::span<const Measurement* const> measurements, int pose, const SE3& present) {
  StarLink link;
  link.T_neighbour_pose = present;
  for (int fit = 0; fit <= kFits; ++fit) {
    link.information.setZero();
    Vector6d gradient = Vector6d::Zero();
    for (const Measurement* m : measurements) {
      const bool to = m->to == pose;
      WhitenedLinear l;
      linearizeWhitened(*m, to ? link.T_neighbour_pose : link.T_neighbour_pose.inverse(), m->weight, l);
      Matrix6d by = l.by_to;
      if (!to) by = -l.by_to * adjoint(link.T_neighbour_pose);
      link.information += by.transpose() * by;
      gradient += by.transpose() * l.error;
    }
    if (fit == kFits) break;
    link.T_neighbour_pose = perturbed(link.T_neighbour_pose, -firmStep(link.information, gradient));
  }
  return link;
}

RelativePose composed(const StarLink& a, double share_a, const StarLink& b, double share_b) {
  RelativePose m;
  m.from = a.neighbour;
  m.to = b.neighbour;
  const SE3 T_pose_b = b.T_neighbour_pose.inverse();
  m.T_from_to = a.T_neighbour_pose * T_pose_b;
  // T_a_p exp(x_a) exp(-x_b) T_p_b = T_a_b exp(adjoint(T_b_p) (x_a - x_b)), to first order.
  const Matrix6d turned = adjoint(T_pose_b);
  const Matrix6d sum = parallelSum(share_a * a.information, share_b * b.information);
  m.information = residualInformation(turned.transpose() * sum * turned);
  return m;
}

int retireStar(std::span<const StarLink> links, std::span<RelativePose> result) {
  if (links.size() < 2) return 0;
  std::size_t root = 0;
  Division best;
  best.loss = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (links[i].neighbour == kWorld) continue;
    const Division d = divide(links, i);
    if (!(d.loss < best.loss)) continue;
    best = d;
    root = i;
  }
  int count = 0;
  for (std::size_t i = 0; i < links.size(); ++i)
    if (i != root)
      result[static_cast<std::size_t>(count++)] = composed(links[i], 1, links[root], best.share[i]);
  return count;
}

}  // namespace fathom::slam
