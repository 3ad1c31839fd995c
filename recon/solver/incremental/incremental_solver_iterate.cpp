// Iterations of the incremental solver: preconditioned conjugate gradients with a watchdog and damping.
#include <algorithm>

#include "recon/solver/incremental/incremental_solver.hpp"

namespace fathom::slam {
namespace {

constexpr int kHalvings = 4;  // of a step that would raise chi2
constexpr double kLeastDamping = 1e-6, kGreatestDamping = 1e6, kMoreDamping = 10;
// With a factor that is right, so many iterations may raise chi2, by this factor, before the best poses are
// taken up again (batch_solver.cpp).
constexpr int kRises = 2;
constexpr double kRise = 4, kRightLength = 0.8;
// The best length along a direction that the factor gives is 1 if the factor is right; a shorter one, or a
// longer one than its inverse, makes the next factor urgent.
constexpr double kShortest = 0.5;
constexpr double kMostBeta = 0.5;  // of conjugate gradients with a factor of all measurements
constexpr int kLeastGrowth = 16, kGrowthShare = 8;  // measurements until poses may be recomposed again

}  // namespace

// One iteration of preconditioned conjugate gradients; false when there is no more to gain.
bool IncrementalSolver::iterate(StepReport& report) {
  const bool fresh = active().moves == moves_;
  if (at_minimum_) return false;
  if (rises_ > 0 && !fresh) {  // uphill, only a factor of the present poses gives a descent direction
    urgent_ = true;
    return false;
  }
  const int n = kBlockSize * poses_count_;
  const std::span<const double> gradient = errors_.gradient();
  report.solve_work +=
      active().factor.solve(gradient.data(), solved_.data(),
                            config_.least_effect * config_.least_decrease * errors_.chi2() / living());
  double product = 0, change = 0;
  for (int i = 0; i < n; ++i) {
    product += gradient[at(i)] * solved_[at(i)];
    change += gradient_before_[at(i)] * solved_[at(i)];
  }
  const bool damped = active().damping > 0;
  report.decrease_expected = damped ? errors_.chi2() : product;
  if (!(product > config_.least_decrease * errors_.chi2() + IncrementalConfig::kNothing)) {
    if (rises_ > 0) return takeUpBest(report);
    if (!damped) return startFromMeasurements(report);
    // From these poses less damping has been refused; from others it is worth a factor.
    if (fresh) return stopHere(report);
    easeDamping();
    urgent_ = true;
    return false;
  }
  const double slope = turnDirection(product, change);
  double length = -slope / errors_.curvature(direction_);
  gatherMoving();
  const double before = errors_.chi2(), best = rises_ > 0 ? best_chi2_ : before;
  // In a long, curved valley chi2 may rise before it falls.
  const bool right = length > kRightLength && length < 1 / kRightLength;
  const double most = right && rises_ < kRises ? kRise * best : best;
  moveBy(length);
  for (int halving = 0; !(errors_.chi2() <= most) && halving < kHalvings; ++halving) {
    length /= 2;
    moveBy(length);
    restart_ = true;
  }
  // Chi2 does not fall along a direction of a factor that is out of date,
  // or beyond where its linearisation holds.
  if (!(errors_.chi2() <= most)) {
    moveBy(0);
    return rises_ > 0 ? takeUpBest(report) : refuseDirection(report, fresh);
  }
  ++moves_;
  ++report.iterations;
  if (errors_.chi2() > best) {
    if (rises_++ == 0) {
      std::copy(poses_.begin(), poses_.begin() + poses_count_, best_.begin());
      for (const int i : moved_.subspan(0, at(moved_count_))) best_[at(i)] = saved_[at(i)];
      best_chi2_ = before;
    }
  } else {
    rises_ = 0;
    easeDamping();
  }
  if (rises_ > 0 || (active().left_out == 0 && (length < kShortest || length > 1 / kShortest)))
    urgent_ = restart_ = true;
  return true;
}

// The next direction, conjugate to the last; returns the slope of chi2 along it.
double IncrementalSolver::turnDirection(double product, double change) {
  const int n = kBlockSize * poses_count_;
  const std::span<const double> gradient = errors_.gradient();
  double beta = restart_ ? 0 : std::max(0.0, (product - change) / product_before_);
  if (active().left_out == 0 && beta > kMostBeta) beta = 0;
  double slope = 0;
  for (int i = 0; i < n; ++i) {
    direction_[at(i)] = (beta > 0 ? beta * direction_[at(i)] : 0) - solved_[at(i)];
    slope += gradient[at(i)] * direction_[at(i)];
  }
  if (slope >= 0) {
    for (int i = 0; i < n; ++i) direction_[at(i)] = -solved_[at(i)];
    slope = -product;
  }
  for (int i = 0; i < n; ++i) gradient_before_[at(i)] = gradient[at(i)];
  product_before_ = product;
  restart_ = false;
  return slope;
}

// Notes the poses that the direction moves, and where they are.
void IncrementalSolver::gatherMoving() {
  moved_count_ = 0;
  for (int i = 0; i < poses_count_; ++i) {
    if (fixed_[at(i)] || Eigen::Map<const PosePerturbation>(&direction_[at(kBlockSize * i)]).isZero(0))
      continue;
    moved_[at(moved_count_++)] = i;
    saved_[at(i)] = poses_[at(i)];
  }
  noteChanged({moved_.data(), at(moved_count_)});
}

// Poses a share of the direction away from where they were.
void IncrementalSolver::moveBy(double share) {
  const std::span<const int> moving(moved_.data(), at(moved_count_));
  for (const int i : moving)
    poses_[at(i)] = perturbedInWorld(
        saved_[at(i)], share * Eigen::Map<const PosePerturbation>(&direction_[at(kBlockSize * i)]));
  errors_.follow(moving);
}

void IncrementalSolver::easeDamping() {
  damping_ = damping_ > kLeastDamping ? damping_ / kMoreDamping : 0;
}

// Returns to the poses before iterations that raised chi2 without a gain.
bool IncrementalSolver::takeUpBest(StepReport& report) {
  moved_count_ = 0;
  for (int i = 0; i < poses_count_; ++i) {
    if (fixed_[at(i)] || isRetired(i)) continue;
    moved_[at(moved_count_++)] = i;
    poses_[at(i)] = best_[at(i)];
  }
  const std::span<const int> moving(moved_.data(), at(moved_count_));
  noteChanged(moving);
  errors_.follow(moving);
  rises_ = 0;
  ++moves_;
  return refuseDirection(report, true);
}

// Makes the next factor urgent: at these poses or, if the present one is at these, a damped one.
bool IncrementalSolver::refuseDirection(StepReport& report, bool damp) {
  urgent_ = restart_ = true;
  if (!damp) return false;
  damping_ = std::max(kMoreDamping * active().damping, kLeastDamping);
  return damping_ > kGreatestDamping && stopHere(report);
}

// No direction leads down from here. The next factor is undamped, for covariances.
bool IncrementalSolver::stopHere(StepReport& report) {
  damping_ = 0;
  urgent_ = at_minimum_ = true;
  return startFromMeasurements(report);
}

// Leaves a local minimum: poses at rest are replaced by poses composed of the fewest measurements from the
// pose that is held, if their chi2 is less.
bool IncrementalSolver::startFromMeasurements(StepReport& report) {
  if (measurements_.births() < next_start_) return false;
  next_start_ =
      measurements_.births() + std::max<std::int64_t>(kLeastGrowth, measurements_.births() / kGrowthShare);
  const double before = errors_.chi2();
  std::copy(poses_.begin(), poses_.begin() + poses_count_, saved_.begin());
  const std::span<std::uint8_t> reached = is_newest_;
  std::copy(fixed_.begin(), fixed_.end(), reached.begin());
  moved_count_ = 0;
  for (int i = 0; i < poses_count_; ++i)
    if (fixed_[at(i)]) moved_[at(moved_count_++)] = i;
  for (int next = 0; next < moved_count_; ++next) {
    const int pose = moved_[at(next)];
    for (int k = measurements_.first(pose); k >= 0; k = measurements_.next(k, pose)) {
      const Measurement& m = measurements_[k];
      const int other = m.to == pose ? m.from : m.to;
      if (!errors_.has(k) || m.weight == 0 || other == kWorld || reached[at(other)] != 0 || !hasFullRank(k))
        continue;
      reached[at(other)] = 1;
      poses_[at(other)] = poses_[at(pose)] * (m.to == other ? m.T_from_to : m.T_from_to.inverse());
      moved_[at(moved_count_++)] = other;
    }
  }
  const std::span<const int> moving(moved_.data(), at(moved_count_));
  errors_.follow(moving);
  report.solve_work += 2 * (measurements_.count() + moved_count_);
  if (!(errors_.chi2() < before)) {
    for (const int i : moving) poses_[at(i)] = saved_[at(i)];
    errors_.follow(moving);
    return false;
  }
  noteChanged(moving);
  ++moves_;
  ++report.iterations;
  at_minimum_ = false;
  urgent_ = restart_ = true;
  return true;
}

void IncrementalSolver::displace(std::span<const int> poses, const SE3& by) {
  for (const int i : poses)
    if (!fixed_[at(i)]) poses_[at(i)] = by * poses_[at(i)];
  noteChanged(poses);
  errors_.follow(poses);
  ++moves_;
  rises_ = 0;
  damping_ = 0;
  at_minimum_ = false;
  urgent_ = restart_ = true;
}

void IncrementalSolver::noteChanged(std::span<const int> poses) {
  for (const int i : poses) {
    if (is_changed_[at(i)] || fixed_[at(i)]) continue;
    is_changed_[at(i)] = 1;
    changed_[at(changed_count_++)] = i;
  }
}

}  // namespace fathom::slam
