#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/kernel/memory/arena.hpp"
#include "recon/solver/incremental/factor_builder.hpp"
#include "recon/solver/incremental/growing_factor.hpp"
#include "recon/solver/incremental/present_errors.hpp"
#include "recon/solver/measurements.hpp"

namespace fathom::slam {

// First in, first out, of indices, in memory that another owns; never more than it has room for.
class IndexQueue {
 public:
  IndexQueue() = default;
  explicit IndexQueue(std::span<int> room) : room_(room) {}

  void clear() { first_ = count_ = 0; }
  [[nodiscard]] bool empty() const { return count_ == 0; }
  [[nodiscard]] int size() const { return count_; }
  [[nodiscard]] int front() const { return room_[static_cast<std::size_t>(first_)]; }
  void push(int index) {
    const int room = static_cast<int>(room_.size());
    room_[static_cast<std::size_t>((first_ + count_++) % room)] = index;
  }
  void pop() {
    first_ = (first_ + 1) % static_cast<int>(room_.size());
    --count_;
  }

 private:
  std::span<int> room_;
  int first_ = 0, count_ = 0;
};

// Work is counted in products of two 6 x 6 blocks (432 operations, 40 ns to 60 ns).
struct IncrementalConfig {
  int max_poses = 20000;
  int max_measurements = 30000;
  std::int64_t max_factor_blocks = 200000;  // below the diagonal, of each of two factors; 292 bytes each
  int iterations = 3;                       // of a step with one factor, at most
  // Share of chi2 that an iteration must have promised for another to follow in the same step.
  double continue_from = 0.01;
  std::int64_t update_quota = 60000;   // of a step, to take measurements into the factor
  std::int64_t build_quota = 40000;    // of a step, for the next factor
  std::int64_t urgent_quota = 150000;  // the same, when most of the present factor is out of date
  int rebuild_after = 16;              // poses that come after a factor was begun, before the next
  // Share of chi2 that one more iteration must promise: with less, a step ends.
  double least_decrease = 1e-6;
  static constexpr double kNothing = 1e-12;  // or this of chi2: what rounding leaves of perfect measurements
  // Share of that, all poses together: smaller corrections wait until they have grown. Corrections that wait
  // let the graph drift: with 1e-4, steps known to 0.3 mm and a place known to half a metre, by 0.1 m.
  double least_effect = 1e-12;
  // Newest poses that a new factor's order keeps for the end, where most closures join; a quarter of them
  // where most closures reach further back.
  int kept_last = 64;

  // Blocks of a factor for so many poses, and measurements beyond the one that
  // joins each pose to the last: closures between neighbouring and crossing lines
  // fill 30 each (20,000 poses with 2,000; tests/bench/slam), and columns that
  // move leave a third behind. Closures that join any two poses fill far more.
  [[nodiscard]] static std::int64_t blocksFor(int poses, int closures);

  void validate() const;  // throws std::invalid_argument
};

struct StepReport {
  double chi2 = 0;
  // Of chi2 by the next iteration, as the last one predicted; all of chi2 where it was damped.
  double decrease_expected = 0;
  int iterations = 0;
  int poses_moved = 0;
  std::int64_t solve_work = 0, update_work = 0, build_work = 0;
  int measurements_waiting = 0;  // not yet in the factor
  int factors_replaced = 0;
  bool waits_for_factor = false;  // poses stay until the next factor is there
};

enum class RetireStatus {
  kOk,
  kNoSuchPose,
  kHeld,          // the first pose stays
  kNotSettled,    // one of its measurements is not yet in the factors: ask again some steps later
  kTooManyLinks,  // kMostLinks
};

// Maximum likelihood poses of a graph that grows, in fixed memory and with bounded work a step.
//
// The gradient of chi2 is always that of the present poses. A factor of the normal equations, whose
// linearisation may be older, preconditions conjugate gradients on it (Polak & Ribiere 1969), so that an
// old linearisation costs iterations but not accuracy. New poses and measurements enter the factor along
// their path in the elimination tree; meanwhile a new factor, of better order and fresh linearisation, is
// built in slices and replaces it (sources in growing_factor.hpp and factor_builder.hpp).
//
// A pose that is no longer needed is retired: its measurements are replaced by composed ones between its
// neighbours (retirement.hpp), and its index is free for a later pose. A mission of any length then needs the
// memory of a part of it.
//
// The first pose is held. Same calls, same bytes. No memory is taken after construction.
class IncrementalSolver {
 public:
  explicit IncrementalSolver(const IncrementalConfig& config);
  static std::size_t bytesNeeded(const IncrementalConfig& config);

  // kFull: config.max_poses is reached; retire one. `index`, if given, receives the pose's index: size() - 1,
  // or that of a retired one.
  AddStatus addPose(const SE3& T_world_pose, int* index = nullptr);
  // See Measurements::add. `from` = kWorld measures the pose `to` itself. `index`: measurements() - 1, or
  // that of one that went with a pose.
  AddStatus addMeasurement(const RelativePose& measurement, int* index = nullptr);
  // Scales the information of a measurement; 0 takes it out. False when there is no such one.
  bool setWeight(int measurement, double weight);
  // Frees the place of a measurement that was taken out. False until the factors are without it.
  bool forget(int measurement);
  // Where a pose that no step has seen yet starts from; false: one has.
  bool startAt(int pose, const SE3& T_world_pose);
  StepReport step();
  // Moves poses as one body, T <- by T, to a better start: from far away
  // the descent may end in another minimum.
  void displace(std::span<const int> poses, const SE3& by);

  // Retires a pose with all its measurements. What they say about its neighbours is kept without loss if
  // there are two, and else in part, never more than was known. Switched-off measurements are forgotten.
  RetireStatus retire(int pose);
  // The pose that the map needs least, of those that may be retired now: with few neighbours, and those near;
  // not of the newest `keep`, nor with a nonzero place in `must_stay`. Looks at a bounded number of poses,
  // from where the last call ended; -1: none.
  int leastNeeded(int keep, std::span<const std::uint8_t> must_stay);
  int leastNeeded(int keep) { return leastNeeded(keep, {}); }
  bool isRetired(int i) const { return created_[at(i)] < 0; }
  std::int64_t retired() const { return retired_; }  // so far

  int size() const { return poses_count_; }  // indices are below; without poses retired, their number
  int living() const { return poses_count_ - free_count_; }
  int measurements() const { return measurements_.size(); }  // the same of measurements
  // As it is now, composed ones too; not `in_use` where a retired pose left a place free.
  const Measurement& measurement(int k) const { return measurements_[k]; }
  int measurementsInUse() const { return measurements_.count(); }
  // Those that name a pose: for (k = firstMeasurement(i); k >= 0; k = nextMeasurement(k, i)).
  int firstMeasurement(int i) const { return measurements_.first(i); }
  int nextMeasurement(int k, int i) const { return measurements_.next(k, i); }
  const SE3& pose(int i) const { return poses_[at(i)]; }
  // Poses that the last step moved.
  std::span<const int> moved() const { return {changed_.data(), at(changed_count_)}; }
  double chi2() const { return errors_.chi2(); }  // after the last step
  // Chi2 of one measurement, at the last step.
  double chi2Of(int measurement) const { return errors_.chi2Of(measurement); }

  // Covariance of a pose's perturbation in its own frame (uncertain_pose.hpp), by the factor; zero for
  // a pose that is held, next to infinite for one that is not yet in the factor. And of the relative pose
  // T_a_b, by its right perturbation. Greater than the truth while measurements are leftOut().
  Matrix6d covariance(int pose);
  Matrix6d relativeCovariance(int a, int b);
  // Gradient by the perturbation of a measurement's `to`, and less that of `from`, per error of its T_from_to
  // (right perturbation): information times perturbation. And the solution of the normal equations with such
  // gradients, six numbers for each of max_poses; poses that the factor does not have yet keep theirs.
  [[nodiscard]] Matrix6d gradientPerError(int measurement) const;
  void solve(std::span<const double> gradients, std::span<double> moved);

  std::size_t memoryBytes() const { return arena_.capacity(); }
  std::int64_t factorBlocks() const { return active().factor.blocksInUse(); }
  // Blocks of the store that the factor occupies, with what moved columns have left behind; and its size.
  std::int64_t factorStoreUsed() const { return active().factor.storeUsed(); }
  std::int64_t factorStore() const { return config_.max_factor_blocks; }
  // Measurements that the factor does not have yet.
  int waiting() const { return fresh_count_ + active().to_come.size(); }
  // Measurements that the factor is without, because its store has no room for their fill. The solution is of
  // all measurements, but takes more iterations.
  int leftOut() const { return active().left_out; }

  // Into a solver of the same sizes: poses bit by bit, the factor built again (incremental_solver_build.cpp).
  // A solver whose load() failed is of no use.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  enum class Part : std::uint8_t {
    kNone,      // not in the factor
    kItself,    // as in_factor says
    kByOthers,  // composed of measurements that are still in the factor
    kLeftOut,   // there is no room for it
  };
  struct Factor {
    GrowingFactor factor;
    std::span<InFactor> in_factor;
    std::span<Part> part;               // of each measurement
    IndexQueue poses_to_come, to_come;  // poses and measurements that it does not have yet
    double damping = 0;
    std::int64_t moves = 0;  // moves_ when it was begun
    int left_out = 0;        // measurements of that part
  };
  Factor& active() { return factors_[at(active_)]; }
  const Factor& active() const { return factors_[at(active_)]; }
  double staleness(int k) const;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  [[nodiscard]] bool posesAreValid() const;
  void rebuildFactor();

  std::int64_t update(Factor& f, double sign, int k);

  std::int64_t extend(Factor& f, std::int64_t quota);
  AddStatus take(const RelativePose& measurement, bool composed, int* index);
  void takeNew();
  void restartSearch();
  void beginBuild();
  void chooseLeftOut();
  int laterEnd(int k) const;
  bool hasFullRank(int k) const;
  bool joins(int k) const;
  void setPart(Factor& f, int k, Part part);
  void settle(Factor& f);
  bool isSettled(int pose) const;
  bool isTakenIn(int k) const;
  void removeMeasurement(int k);
  void addComposed(RelativePose composed);
  void refresh(StepReport& report);
  bool iterate(StepReport& report);
  double turnDirection(double product, double change);
  void gatherMoving();
  void moveBy(double share);
  void easeDamping();
  bool takeUpBest(StepReport& report);
  bool refuseDirection(StepReport& report, bool damp);
  bool stopHere(StepReport& report);
  bool startFromMeasurements(StepReport& report);
  void noteChanged(std::span<const int> poses);
  void build(StepReport& report);

  IncrementalConfig config_;
  rt::Arena arena_;
  Measurements measurements_;
  std::span<SE3> poses_;
  std::span<std::uint8_t> fixed_;
  std::span<std::int64_t> created_;  // number of poses that came before; -1: retired
  std::span<int> free_;              // indices of retired poses
  PresentErrors errors_;
  GrowingFactor::Work factor_work_;
  std::array<Factor, 2> factors_;
  FactorBuilder builder_;
  int active_ = 0;

  std::span<SE3> saved_, best_;  // poses before an iteration, and before iterations that raised chi2
  std::span<double> stale_;      // of measurements: staleness in the active factor
  std::span<double> gradient_before_, solved_, direction_;
  std::span<int> moved_, changed_, fresh_;  // fresh: measurements that no step has seen
  std::span<std::uint8_t> is_changed_, is_newest_;
  std::span<std::uint8_t> is_left_out_;  // of measurements, by the next factor
  int poses_count_ = 0, free_count_ = 0, fresh_count_ = 0, scanned_ = 0, moved_count_ = 0, changed_count_ = 0,
      rises_ = 0;
  double product_before_ = 0;
  double best_chi2_ = 0;
  double damping_ = 0;           // of the next factor
  std::int64_t moves_ = 0;       // of poses by iterations
  std::int64_t next_start_ = 0;  // births of measurements before poses may be recomposed
  // Share of closures, newest weigh most, with one of the `kept_last` newest poses.
  double short_closures_ = 1;
  std::int64_t work_of_update_ = 1, work_of_build_ = 0, build_work_ = 0;
  std::int64_t poses_ever_ = 0, retired_ = 0;  // of poses
  int thinning_ = 0;                           // of measurements for which there is no room; 0: all are taken
  std::int64_t thin_until_ = 0, no_build_until_ = 0;  // births of poses before less is tried, or a factor
  std::int64_t poses_at_build_ = 0, measurements_at_build_ = 0;  // births, when the next factor was begun
  bool restart_ = true, building_ = false, is_built_ = false, urgent_ = false;
  bool at_minimum_ = false;  // not by any damping, from where the poses are
};

}  // namespace fathom::slam
