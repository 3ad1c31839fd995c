#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "recon/slam/arena_array.hpp"
#include "recon/slam/factor_builder.hpp"
#include "recon/slam/growing_factor.hpp"
#include "recon/slam/measurements.hpp"
#include "recon/slam/present_errors.hpp"

namespace fathom::slam {

// Work is counted in products of two 6 x 6 blocks (432 operations, 40 ns to 60 ns).
struct IncrementalConfig {
  int max_poses = 20000;
  int max_measurements = 30000;
  std::int64_t max_factor_blocks = 200000;  // below the diagonal, of each of two factors; 292 bytes each
  int iterations = 3;                       // of a step with one factor, at most
  std::int64_t update_quota = 60000;        // of a step, to take measurements into the factor
  std::int64_t build_quota = 40000;         // of a step, for the next factor
  std::int64_t urgent_quota = 150000;       // the same, when most of the present factor is out of date
  int rebuild_after = 16;                   // poses that come after a factor was begun, before the next
  // Share of chi2 that one more iteration must promise: with less, a step ends.
  double least_decrease = 1e-6;
  // Share of that, all poses together: smaller corrections wait until they have grown.
  double least_effect = 1e-4;
  // Newest poses that a new factor's order keeps for the end, where most closures join; a quarter of them
  // where most closures reach further back.
  int kept_last = 64;

  // Blocks of a factor for so many poses, and measurements beyond the one that joins each pose to the last:
  // closures between neighbouring and crossing lines fill 30 each (20,000 poses with 2,000;
  // tests/bench/slam), and columns that move leave a third behind. Closures that join any two poses fill far
  // more.
  [[nodiscard]] static std::int64_t blocksFor(int poses, int closures);

  void validate() const;  // throws std::invalid_argument
};

struct StepReport {
  double chi2 = 0;
  double decrease_expected = 0;  // of chi2 by the next iteration, as the last one saw it
  int iterations = 0;
  int poses_moved = 0;
  std::int64_t solve_work = 0, update_work = 0, build_work = 0;
  int measurements_waiting = 0;  // not yet in the factor
  int factors_replaced = 0;
  bool waits_for_factor = false;  // poses stay until the next factor is there
};

// Maximum likelihood poses of a graph that grows, in fixed memory and with bounded work a step.
//
// The gradient of chi2 is always that of the present poses. A factor of the normal equations, whose
// linearisation may be older, preconditions conjugate gradients on it (Polak & Ribiere 1969), so that an
// old linearisation costs iterations but not accuracy. New poses and measurements enter the factor along
// their path in the elimination tree; meanwhile a new factor, of better order and fresh linearisation, is
// built in slices and replaces it (sources in growing_factor.hpp and factor_builder.hpp).
//
// The first pose is held. Same calls, same bytes. No memory is taken after construction.
class IncrementalSolver {
 public:
  explicit IncrementalSolver(const IncrementalConfig& config);
  static std::size_t bytesNeeded(const IncrementalConfig& config);

  // kFull: the number of poses that the solver was made for is reached.
  AddStatus addPose(const SE3& T_world_pose);
  // See Measurements::add. `from` = kWorld measures the pose `to` itself.
  AddStatus addMeasurement(const RelativePose& measurement);
  // Scales the information of a measurement; 0 takes it out. False when there is no such one.
  bool setWeight(int measurement, double weight);
  StepReport step();

  int size() const { return poses_count_; }
  int measurements() const { return measurements_.size(); }
  const Measurement& measurement(int k) const { return measurements_[k]; }
  const SE3& pose(int i) const { return poses_[at(i)]; }
  // Poses that the last step moved.
  std::span<const int> moved() const { return {changed_.data(), at(changed_count_)}; }
  double chi2() const { return errors_.chi2(); }  // after the last step
  // Chi2 of one measurement, at the last step.
  double chi2Of(int measurement) const { return errors_.chi2Of(measurement); }

  // Covariance of a pose's perturbation in its own frame (pose_graph.hpp: perturbed), by the factor; zero for
  // a pose that is held. And of the relative pose T_a_b, perturbed in the same way.
  Matrix6d covariance(int pose);
  Matrix6d relativeCovariance(int a, int b);

  std::size_t memoryBytes() const { return arena_.capacity(); }
  std::int64_t factorBlocks() const { return active().factor.blocksInUse(); }
  // Blocks of the store that the factor occupies, with what columns that moved have left behind; and its
  // size.
  std::int64_t factorStoreUsed() const { return active().factor.storeUsed(); }
  std::int64_t factorStore() const { return config_.max_factor_blocks; }
  std::int64_t fillDropped() const { return active().factor.dropped(); }

 private:
  struct Factor {
    GrowingFactor factor;
    std::span<InFactor> in_factor;
    int poses = 0, measurements = 0;  // that it holds
  };
  static std::size_t at(std::int64_t i) { return static_cast<std::size_t>(i); }
  Factor& active() { return factors_[at(active_)]; }
  const Factor& active() const { return factors_[at(active_)]; }
  double staleness(int k) const;

  std::int64_t update(Factor& f, double sign, int k);

  std::int64_t extend(Factor& f, std::int64_t quota);
  void refresh(StepReport& report);
  bool iterate(StepReport& report);
  void build(StepReport& report);

  IncrementalConfig config_;
  rt::Arena arena_;
  Measurements measurements_;
  std::span<SE3> poses_;
  std::span<std::uint8_t> held_;
  PresentErrors errors_;
  std::array<Factor, 2> factors_;
  FactorBuilder builder_;
  int active_ = 0;

  std::span<SE3> saved_;
  std::span<double> stale_;  // of measurements: staleness in the active factor
  std::span<double> gradient_before_, solved_, direction_;
  std::span<int> moved_, changed_;
  std::span<std::uint8_t> is_changed_;
  int poses_count_ = 0, moved_count_ = 0, changed_count_ = 0, rises_ = 0;
  double product_before_ = 0;
  double closes_late_ = 1;  // share of closures, newest weigh most, with one of the `kept_last` newest poses
  std::int64_t work_of_update_ = 1, work_of_build_ = 0, build_work_ = 0;
  bool restart_ = true, building_ = false, urgent_ = false;
};

}  // namespace fathom::slam
