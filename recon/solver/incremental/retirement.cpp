#include "recon/solver/incremental/retirement.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "recon/geometry/uncertain_pose.hpp"
#include "recon/solver/incremental/incremental_solver.hpp"

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

constexpr int kMostMeasurements = 2 * kMostLinks;  // of a pose that can be retired
constexpr int kScan = 1024;                        // indices that one call of leastNeeded looks at
constexpr int kChainLinks = 2;                     // neighbours of a pose within a chain
// A neighbour more is worth as much as so long a gap in the map [m]: about a line of a survey.
constexpr double kLinkWorth_m = 10;

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

// Whether the factors have a measurement with its present weight.
bool IncrementalSolver::isTakenIn(int k) const {
  const Measurement& m = measurements_[k];
  const Part part = active().part[at(k)];
  if (!errors_.has(k) || part == Part::kNone) return false;
  if (part != Part::kLeftOut && m.weight != (part == Part::kItself ? active().in_factor[at(k)].weight : 1))
    return false;
  if (!building_) return true;
  const bool in_next = m.born < measurements_at_build_;
  if (in_next && is_left_out_[at(k)] != 0) return true;
  return in_next ? m.weight == builder_.weightOf(k) : m.composed;
}

// Whether a pose's measurements are in the factors, so that what is composed of them is in them as well.
bool IncrementalSolver::isSettled(int pose) const {
  if (!active().factor.has(pose) || (building_ && created_[at(pose)] >= poses_at_build_)) return false;
  for (int k = measurements_.first(pose); k >= 0; k = measurements_.next(k, pose))
    if (!isTakenIn(k)) return false;
  return true;
}

bool IncrementalSolver::forget(int k) {
  if (k < 0 || k >= measurements_.size() || !measurements_[k].in_use || measurements_[k].weight != 0 ||
      !isTakenIn(k))
    return false;
  removeMeasurement(k);
  errors_.refresh();
  return true;
}

void IncrementalSolver::removeMeasurement(int k) {
  errors_.drop(k);
  measurements_.remove(k);
  stale_[at(k)] = 0;
  for (Factor& f : factors_) setPart(f, k, Part::kNone);
}

// Adds a measurement composed of some that the factors have; joins it
// with an earlier one between the same two poses.
void IncrementalSolver::addComposed(RelativePose composed) {
  int k = -1;
  if (take(composed, true, &k) != AddStatus::kOk) return;
  const auto partner = [&](int other) {
    const Measurement& m = measurements_[other];
    return other != k && m.composed && std::minmax(m.from, m.to) == std::minmax(composed.from, composed.to);
  };
  for (int other = measurements_.first(composed.to); other >= 0;
       other = measurements_.next(other, composed.to)) {
    if (!partner(other)) continue;
    const std::array<const Measurement*, 2> both{&measurements_[k], &measurements_[other]};
    const SE3 from = composed.from == kWorld ? SE3() : poses_[at(composed.from)];
    const StarLink link = starLink(both, composed.to, from.inverse() * poses_[at(composed.to)]);
    composed.T_from_to = link.T_neighbour_pose;
    composed.information = residualInformation(link.information);
    removeMeasurement(other);
    measurements_.remove(k);
    if (take(composed, true, &k) != AddStatus::kOk) return;
    break;
  }
  for (Factor& f : factors_) {
    if (&f != &active() && !(building_ && is_built_)) continue;
    setPart(f, k, Part::kByOthers);
    f.in_factor[at(k)].weight = 1;
  }
  stale_[at(k)] = 0;
  errors_.take(k);
}

RetireStatus IncrementalSolver::retire(int pose) {
  if (pose < 0 || pose >= poses_count_ || isRetired(pose)) return RetireStatus::kNoSuchPose;
  if (fixed_[at(pose)]) return RetireStatus::kHeld;
  if (!isSettled(pose)) return RetireStatus::kNotSettled;
  std::array<std::pair<int, int>, kMostMeasurements> star;  // neighbour, measurement
  std::size_t count = 0;
  for (int k = measurements_.first(pose); k >= 0; k = measurements_.next(k, pose)) {
    if (count == star.size()) return RetireStatus::kTooManyLinks;
    const Measurement& m = measurements_[k];
    star[count++] = {m.from == pose ? m.to : m.from, k};
  }
  std::sort(star.begin(), star.begin() + static_cast<std::ptrdiff_t>(count));
  std::array<StarLink, kMostLinks> links;
  std::size_t link_count = 0;
  for (std::size_t i = 0; i < count;) {
    const int neighbour = star[i].first;
    std::array<const Measurement*, kMostMeasurements> group;
    std::size_t in_group = 0;
    for (; i < count && star[i].first == neighbour; ++i)
      if (measurements_[star[i].second].weight > 0) group[in_group++] = &measurements_[star[i].second];
    if (in_group == 0) continue;
    if (link_count == links.size()) return RetireStatus::kTooManyLinks;
    const SE3 from = neighbour == kWorld ? SE3() : poses_[at(neighbour)];
    links[link_count] = starLink({group.data(), in_group}, pose, from.inverse() * poses_[at(pose)]);
    links[link_count++].neighbour = neighbour;
  }
  std::array<RelativePose, kMostLinks> left;
  const int left_count = retireStar({links.data(), link_count}, left);

  for (std::size_t i = 0; i < count; ++i) removeMeasurement(star[i].second);
  for (int i = 0; i < left_count; ++i) addComposed(left[at(i)]);
  errors_.refresh();
  // The next factor buries it when it is settled, or now if it has been.
  for (Factor& f : factors_)
    if ((&f == &active() || (building_ && is_built_)) && f.factor.has(pose))
      f.factor.removePose(f.factor.positionOf(pose));
  created_[at(pose)] = -1;
  free_[at(free_count_++)] = pose;
  ++retired_;
  restartSearch();
  return RetireStatus::kOk;
}

int IncrementalSolver::leastNeeded(int keep, std::span<const std::uint8_t> must_stay) {
  int best = -1;
  double least = std::numeric_limits<double>::infinity();
  for (int seen = 0; seen < std::min(kScan, poses_count_); ++seen) {
    scanned_ = (scanned_ + 1) % poses_count_;
    const int pose = scanned_;
    if (isRetired(pose) || fixed_[at(pose)] || created_[at(pose)] >= poses_ever_ - keep) continue;
    if (at(pose) < must_stay.size() && must_stay[at(pose)] != 0) continue;
    std::array<int, kMostLinks> neighbours;
    int links = 0, measured = 0;
    double nearest[kChainLinks] = {};
    bool fits = true;
    for (int k = measurements_.first(pose); k >= 0 && fits; k = measurements_.next(k, pose)) {
      const Measurement& m = measurements_[k];
      const int other = m.from == pose ? m.to : m.from;
      fits = ++measured <= kMostMeasurements;
      if (other == kWorld || m.weight == 0 ||
          std::find(neighbours.begin(), neighbours.begin() + links, other) != neighbours.begin() + links)
        continue;
      fits = fits && links + 1 < kMostLinks;
      if (!fits) break;
      neighbours[at(links)] = other;
      const double apart = (poses_[at(pose)].translation() - poses_[at(other)].translation()).norm();
      if (links < kChainLinks) {
        nearest[links] = apart;
      } else if (double& farther = nearest[0] > nearest[1] ? nearest[0] : nearest[1]; apart < farther) {
        farther = apart;
      }
      ++links;
    }
    const double worth = kLinkWorth_m * std::max(0, links - kChainLinks) + nearest[0] + nearest[1];
    if (!fits || worth >= least || !isSettled(pose)) continue;
    least = worth;
    best = pose;
  }
  return best;
}

}  // namespace fathom::slam
