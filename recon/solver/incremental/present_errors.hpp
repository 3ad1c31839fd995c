#pragma once

#include <cstdint>
#include <span>

#include "realtime/kernel/memory/arena.hpp"
#include "recon/solver/measurements.hpp"

namespace fathom::slam {

// The errors of measurements at the present poses, and what follows from them: chi2, its gradient, its
// curvature along a direction. Only what touches moved poses is computed again. The gradient is exact: in the
// soft directions of a long chain, one from derivatives that are a thousandth old would leave poses many
// standard deviations away. Curvature may use slightly older ones. No memory is taken after construction.
class PresentErrors {
 public:
  // All must outlive this; `held[i]` is not 0 for a fixed pose.
  PresentErrors(const Measurements& measurements, std::span<const SE3> poses,
                std::span<const std::uint8_t> held, int max_measurements, rt::Arena& arena);
  [[nodiscard]] static std::size_t bytes(int max_poses, int max_measurements);

  // Adds or drops a measurement; refresh() after all, and after dropped ones have been removed.
  void take(int measurement);
  void drop(int measurement);
  void refresh() { refreshGradient(); }
  // Evaluates one again after a change of its weight.
  void renew(int measurement);
  // After some poses have moved.
  void follow(std::span<const int> moved);
  // Forgets all.
  void clear();

  [[nodiscard]] bool has(int measurement) const { return is_taken_[at(measurement)] != 0; }
  [[nodiscard]] double chi2() const { return chi2_; }
  [[nodiscard]] double chi2Of(int measurement) const { return chi2_of_[at(measurement)]; }
  // By perturbations in the world frame, six numbers a pose.
  [[nodiscard]] std::span<const double> gradient() const { return gradient_; }
  // p^T H p of the direction p.
  [[nodiscard]] double curvature(std::span<const double> direction) const;
  // Whether a pose of the measurement has moved since this was last asked.
  [[nodiscard]] bool takeMoved(int measurement);
  [[nodiscard]] SE3 fromPose(const Measurement& m) const {
    return m.from == kWorld ? SE3() : poses_[at(m.from)];
  }

 private:
  void linearize(int k);
  void noteError(int k, const Vector6d& plain, const Vector6d& whitened);
  void evaluate(int k);
  void markDirty(int pose);
  void refreshGradient();

  const Measurements& measurements_;
  std::span<const SE3> poses_;
  std::span<const std::uint8_t> fixed_;
  std::span<Matrix6d> by_to_;         // whitened derivatives, which may be slightly older
  std::span<Vector6d> error_then_;    // plain errors where the derivatives were taken
  std::span<PosePerturbation> pull_;  // gradient of each, by the perturbation of `to`
  std::span<std::uint8_t> is_taken_, is_moved_;
  std::span<double> chi2_of_;
  std::span<int> stamp_;  // of measurements: the last evaluation
  std::span<double> gradient_;
  std::span<int> dirty_;
  std::span<std::uint8_t> is_dirty_;
  int dirty_count_ = 0, evaluation_ = 0;
  double chi2_ = 0;
};

}  // namespace fathom::slam
