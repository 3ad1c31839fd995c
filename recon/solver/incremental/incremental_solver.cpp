#include "recon/solver/incremental/incremental_solver.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace fathom::slam {
namespace {

constexpr double kRefactor = 0.1;    // staleness from which a measurement is linearised again
constexpr double kReweighted = 1e9;  // staleness of a measurement whose weight has changed
constexpr int kSparePart = 16;       // this part of a factor's store is kept for measurements that join poses
constexpr int kFactorsPerStep = 8;
constexpr double kUnknownVariance = 1 / GrowingFactor::kLeastInformation;
constexpr double kNewestClosure = 0.02;  // weight of the newest closure in short_closures_

std::size_t arraysOf(const IncrementalConfig& c) {
  const auto poses = static_cast<std::size_t>(c.max_poses),
             edges = static_cast<std::size_t>(c.max_measurements);
  constexpr std::size_t kArrays = 23, kAlignment = alignof(Block);
  return poses * (3 * sizeof(SE3) + 3 * sizeof(std::uint8_t) + 3 * kBlockSize * sizeof(double) +
                  5 * sizeof(int) + sizeof(std::int64_t)) +
         edges * (2 * (sizeof(InFactor) + sizeof(std::uint8_t) + sizeof(int)) + sizeof(double) + sizeof(int) +
                  sizeof(std::uint8_t)) +
         kArrays * kAlignment;
}

// Columns beyond one for each pose: a pose that takes the index of a retired one has a new column until the
// old factor is dropped.
GrowingFactor::Size factorSize(const IncrementalConfig& c) {
  constexpr int kLeastSpare = 64, kPosesPerSpare = 8;
  return {c.max_poses, c.max_poses + std::max(kLeastSpare, c.max_poses / kPosesPerSpare),
          c.max_factor_blocks};
}

// While a factor is built, retired poses free some hundreds of measurements' slots. So many old measurements
// are kept for the builder; when slots of more are used again, it starts again.
FactorBuilder::Size builderSize(const IncrementalConfig& c) {
  constexpr int kLeastKept = 256, kMeasurementsPerKept = 16;
  return {c.max_poses, c.max_measurements, std::max(kLeastKept, c.max_measurements / kMeasurementsPerKept)};
}

}  // namespace

std::int64_t IncrementalConfig::blocksFor(int poses, int closures) {
  constexpr std::int64_t kOfPose = 3, kOfClosure = 40, kLeast = 1000;
  return kLeast + kOfPose * poses + kOfClosure * closures;
}

void IncrementalConfig::validate() const {
  if (max_poses < 1 || max_measurements < 1 || max_factor_blocks < 1)
    throw std::invalid_argument("incremental solver: it needs room for a pose, a measurement and a block");
  if (iterations < 1 || update_quota < 1 || build_quota < 1 || rebuild_after < 1 || kept_last < 0)
    throw std::invalid_argument("incremental solver: a quota of a step is not positive");
  if (!(least_decrease > 0) || !(least_effect >= 0) || !(continue_from >= 0))
    throw std::invalid_argument(
        "incremental solver: least_decrease must be positive, other thresholds not negative");
}

std::size_t IncrementalSolver::bytesNeeded(const IncrementalConfig& c) {
  return arraysOf(c) + PresentErrors::bytes(c.max_poses, c.max_measurements) +
         Measurements::bytes(c.max_poses, c.max_measurements) + GrowingFactor::Work::bytes(factorSize(c)) +
         2 * GrowingFactor::bytesBesideWork(factorSize(c)) + FactorBuilder::bytes(builderSize(c));
}

IncrementalSolver::IncrementalSolver(const IncrementalConfig& config)
    : config_((config.validate(), config)),
      arena_(bytesNeeded(config)),
      measurements_(config.max_poses, config.max_measurements, arena_),
      poses_(arena_.allocateArray<SE3>(at(config.max_poses))),
      fixed_(arena_.allocateArray<std::uint8_t>(at(config.max_poses))),
      created_(arena_.allocateArray<std::int64_t>(at(config.max_poses))),
      free_(arena_.allocateArray<int>(at(config.max_poses))),
      errors_(measurements_, poses_, fixed_, config.max_measurements, arena_),
      factor_work_(factorSize(config), arena_),
      factors_{Factor{GrowingFactor(factorSize(config), arena_, factor_work_), {}, {}, {}, {}},
               Factor{GrowingFactor(factorSize(config), arena_, factor_work_), {}, {}, {}, {}}},
      builder_(builderSize(config), arena_) {
  const auto poses = at(config.max_poses), edges = at(config.max_measurements);
  for (std::span<SE3>* s : {&saved_, &best_}) *s = arena_.allocateArray<SE3>(poses);
  is_changed_ = arena_.allocateArray<std::uint8_t>(poses);
  is_newest_ = arena_.allocateArray<std::uint8_t>(poses);
  fresh_ = arena_.allocateArray<int>(edges);
  is_left_out_ = arena_.allocateArray<std::uint8_t>(edges);
  for (Factor& f : factors_) {
    f.in_factor = arena_.allocateArray<InFactor>(edges);
    f.part = arena_.allocateArray<Part>(edges);
    f.poses_to_come = IndexQueue(arena_.allocateArray<int>(poses));
    f.to_come = IndexQueue(arena_.allocateArray<int>(edges));
  }
  stale_ = arena_.allocateArray<double>(edges);
  for (std::span<double>* s : {&gradient_before_, &solved_, &direction_})
    *s = arena_.allocateArray<double>(kBlockSize * poses);
  for (std::span<int>* s : {&moved_, &changed_}) *s = arena_.allocateArray<int>(poses);
  if (arena_.refused() != 0) throw std::logic_error("incremental solver: its arena is too small");
}

AddStatus IncrementalSolver::addPose(const SE3& T_world_pose, int* index) {
  if (free_count_ == 0 && poses_count_ == config_.max_poses) return AddStatus::kFull;
  if (!isFinite(T_world_pose)) return AddStatus::kBadMeasurement;
  const int pose = free_count_ > 0 ? free_[at(--free_count_)] : poses_count_++;
  fixed_[at(pose)] = poses_ever_ == 0;
  created_[at(pose)] = poses_ever_++;
  poses_[at(pose)] = best_[at(pose)] = T_world_pose;
  active().poses_to_come.push(pose);
  if (building_) factors_[at(1 - active_)].poses_to_come.push(pose);
  if (index != nullptr) *index = pose;
  return AddStatus::kOk;
}

bool IncrementalSolver::startAt(int pose, const SE3& T_world_pose) {
  if (fixed_[at(pose)] || active().factor.has(pose)) return false;
  poses_[at(pose)] = best_[at(pose)] = T_world_pose;
  return true;
}

AddStatus IncrementalSolver::addMeasurement(const RelativePose& measurement, int* index) {
  for (const int end : {measurement.from, measurement.to})
    if (end >= 0 && end < poses_count_ && isRetired(end)) return AddStatus::kNoSuchPose;
  int k = -1;
  const AddStatus status = take(measurement, false, &k);
  if (status != AddStatus::kOk) return status;
  fresh_[at(fresh_count_++)] = k;
  if (index != nullptr) *index = k;
  if (measurement.from == kWorld) return status;
  const std::int64_t apart = std::abs(created_[at(measurement.to)] - created_[at(measurement.from)]);
  if (apart > 1)
    short_closures_ += kNewestClosure * ((apart <= config_.kept_last ? 1.0 : 0.0) - short_closures_);
  return status;
}

// Stores a measurement; the factor that is being built may still need what its slot held.
AddStatus IncrementalSolver::take(const RelativePose& measurement, bool composed, int* index) {
  if (building_ && !builder_.keep(measurements_.nextPlace())) building_ = false;
  return measurements_.add(measurement, poses_count_, index, composed);
}

bool IncrementalSolver::setWeight(int k, double weight) {
  if (k < 0 || k >= measurements_.size() || !measurements_[k].in_use || !(weight >= 0) ||
      !std::isfinite(weight))
    return false;
  const double before = measurements_[k].weight;
  measurements_.setWeight(k, weight);
  if (!errors_.has(k) || weight == before) return true;
  errors_.renew(k);
  restartSearch();
  if (active().part[at(k)] == Part::kItself) stale_[at(k)] = kReweighted;
  if (active().part[at(k)] == Part::kByOthers) urgent_ = true;
  return true;
}

// Rank update (sign 1) or downdate (-1) of a factor by a measurement as it was linearised in `in_factor`.
std::int64_t IncrementalSolver::update(Factor& f, double sign, int k) {
  const Measurement& m = measurements_[k];
  const InFactor& then = f.in_factor[at(k)];
  const bool from = m.from != kWorld && !fixed_[at(m.from)], to = !fixed_[at(m.to)];
  if (then.weight == 0 || (!from && !to)) return 0;
  const std::int64_t spare = config_.max_factor_blocks / kSparePart;
  return f.factor.update(sign, worldDerivative(m, then), to ? m.to : m.from, from && to ? m.from : -1,
                         joins(k) ? 0 : spare);
}

// New measurements enter the cost now, and the factors as the quota allows.
void IncrementalSolver::takeNew() {
  if (fresh_count_ == 0) return;
  restartSearch();
  for (const int k : fresh_.subspan(0, at(fresh_count_))) {
    errors_.take(k);
    stale_[at(k)] = 0;
    for (Factor& f : factors_) {
      setPart(f, k, Part::kNone);
      if (&f == &active() || building_) f.to_come.push(k);
    }
  }
  fresh_count_ = 0;
  errors_.refresh();
}

// Resets the line search, as chi2 is now of other measurements.
void IncrementalSolver::restartSearch() {
  restart_ = true;
  at_minimum_ = false;
  rises_ = 0;
}

// Adds waiting poses and measurements to a factor, within a quota of work. A pose enters with its first
// measurement: without any it would be unconstrained.
std::int64_t IncrementalSolver::extend(Factor& f, std::int64_t quota) {
  const auto append = [&] {
    if (f.poses_to_come.empty() || !f.factor.append(f.poses_to_come.front())) return false;
    f.poses_to_come.pop();
    return true;
  };
  const auto has = [&](int pose) {
    while (!f.factor.has(pose) && append()) continue;
    return f.factor.has(pose);
  };
  std::int64_t work = 0;
  for (; !f.to_come.empty() && work < quota; f.to_come.pop()) {
    const int k = f.to_come.front();
    const Measurement& m = measurements_[k];
    // Without a free column, the pose and its measurements wait for the next factor.
    if (!has(m.to) || (m.from != kWorld && !has(m.from))) return work;
    f.in_factor[at(k)] = {errors_.fromPose(m), poses_[at(m.to)], m.weight};
    const std::int64_t done = update(f, 1, k);
    setPart(f, k, done == GrowingFactor::kNoRoom ? Part::kLeftOut : Part::kItself);
    if (done != GrowingFactor::kNoRoom) {
      work += done;
    } else if (joins(k)) {  // nothing else constrains this pose: it waits too
      f.factor.removePose(f.factor.positionOf(laterEnd(k)));
      urgent_ = urgent_ || &f == &active();
    }
  }
  while (f.to_come.empty() && append()) continue;
  return work;
}

// How far a measurement's linearisation in the active factor is from the present poses: their rotations
// [rad], and their translations over the measurement's lever arm.
double IncrementalSolver::staleness(int k) const {
  const Measurement& m = measurements_[k];
  const InFactor& then = active().in_factor[at(k)];
  if (m.weight != then.weight) return kReweighted;
  if (m.weight == 0) return 0;
  const SE3& to = poses_[at(m.to)];
  const auto angle = [](const SE3& a, const SE3& b) {
    return 2 * (a.rotation().conjugate() * b.rotation()).vec().norm();
  };
  return (to.translation() - then.T_w_to.translation()).norm() / m.lever + angle(to, then.T_w_to) +
         (m.from == kWorld ? 0
                           : angle(then.T_w_to.inverse() * then.T_w_from, to.inverse() * poses_[at(m.from)]));
}

// Linearises stale measurements of the active factor again, the stalest first, within a quota; many of them
// make the next factor urgent.
void IncrementalSolver::refresh(StepReport& report) {
  const int held = measurements_.size();
  for (int k = 0; k < held; ++k)
    if (active().part[at(k)] == Part::kItself && errors_.takeMoved(k)) stale_[at(k)] = staleness(k);
  const auto stale =
      std::count_if(stale_.begin(), stale_.begin() + held, [](double v) { return v > kRefactor; });
  urgent_ = urgent_ || 2 * stale * work_of_update_ > work_of_build_;
  while (!urgent_ && report.update_work < config_.update_quota) {
    const auto worst = std::max_element(stale_.begin(), stale_.begin() + held);
    if (worst == stale_.begin() + held || *worst < kRefactor) break;
    const int k = static_cast<int>(worst - stale_.begin());
    const Measurement& m = measurements_[k];
    InFactor& in_factor = active().in_factor[at(k)];
    const InFactor then = in_factor, now = {errors_.fromPose(m), poses_[at(m.to)], m.weight};
    in_factor = now;
    *worst = 0;
    const std::int64_t done = update(active(), 1, k);
    if (done == GrowingFactor::kNoRoom) {  // its weight was 0 when the factor was built, so it has no blocks
      in_factor = then;
      setPart(active(), k, Part::kLeftOut);
      continue;
    }
    report.update_work += done;
    in_factor = then;
    report.update_work += update(active(), -1, k);
    in_factor = now;
    restart_ = true;
  }
}

StepReport IncrementalSolver::step() {
  StepReport report;
  for (int i = 0; i < changed_count_; ++i) is_changed_[at(changed_[at(i)])] = 0;
  changed_count_ = 0;
  takeNew();
  const int before = active().to_come.size();
  report.update_work = extend(active(), config_.update_quota);
  if (const int taken = before - active().to_come.size(); taken > 0)
    work_of_update_ = report.update_work / taken + 1;
  // With an outdated factor, iterations would be wasted and would make the factor being built stale too. A
  // small graph takes several factors in one step.
  int iterations = 0, rounds = 0;
  do {
    refresh(report);
    build(report);
    iterations = 0;
    while (!urgent_ && iterations < config_.iterations && iterate(report)) {
      ++iterations;
      if (report.decrease_expected < config_.continue_from * errors_.chi2()) break;
    }
  } while (urgent_ && iterations > 0 && ++rounds < kFactorsPerStep &&
           report.solve_work + report.update_work + report.build_work + work_of_build_ < config_.build_quota);
  report.waits_for_factor = urgent_;
  report.chi2 = errors_.chi2();
  report.poses_moved = changed_count_;
  report.measurements_waiting = active().to_come.size();
  return report;
}

Matrix6d IncrementalSolver::covariance(int i) {
  if (fixed_[at(i)]) return Matrix6d::Zero();
  if (!active().factor.has(i)) return kUnknownVariance * Matrix6d::Identity();
  Matrix6d world;
  active().factor.covariance(i, -1, world.data());
  const Matrix6d own = ownFrame(pose(i));
  return own * world * own.transpose();
}

Matrix6d IncrementalSolver::relativeCovariance(int a, int b) {
  Matrix6d world = Matrix6d::Zero();  // of the difference of their perturbations
  if (a == b) return world;
  if (!active().factor.has(a) || !active().factor.has(b)) return kUnknownVariance * Matrix6d::Identity();
  if (fixed_[at(a)] || fixed_[at(b)]) {
    active().factor.covariance(fixed_[at(a)] ? b : a, -1, world.data());
  } else {
    Eigen::Matrix<double, 12, 12> both;
    active().factor.covariance(a, b, both.data());
    world = both.topLeftCorner<6, 6>() + both.bottomRightCorner<6, 6>() - both.topRightCorner<6, 6>() -
            both.bottomLeftCorner<6, 6>();
  }
  const Matrix6d own = ownFrame(pose(b));
  return own * world * own.transpose();
}

Matrix6d IncrementalSolver::gradientPerError(int measurement) const {
  const Measurement& m = measurements_[measurement];
  const Block b = worldDerivative(m, {errors_.fromPose(m), pose(m.to), m.weight});
  return Eigen::Map<const Matrix6d>(b.v).transpose() * rootByPerturbation(m);
}

void IncrementalSolver::solve(std::span<const double> gradients, std::span<double> moved) {
  (void)active().factor.solve(gradients.data(), solved_.data(), 0);
  for (int i = 0; i < poses_count_; ++i)
    if (active().factor.has(i))
      std::copy_n(&solved_[at(kBlockSize * i)], kBlockSize, &moved[at(kBlockSize * i)]);
}

}  // namespace fathom::slam
