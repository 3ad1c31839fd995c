#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/calibration/epipolar_check.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// Estimates the rig's turn and ratio of focal lengths pair after pair, in fixed memory, from epipolar errors
// of matches. Matches are collected until they fill the view; checkEpipolar() of them is one measurement,
// with its covariance, of the remaining error. The estimate is the information-weighted mean of all
// measurements under a slow random walk, and the rig is corrected by it. A measurement beyond the gate shows
// a rig that was knocked: the estimate is reset. The turn about y, which biases all ranges, is least visible
// in epipolar lines; range errors found from DVL and visual odometry are corrected separately (correctRange).
class RigWatch {
 public:
  explicit RigWatch(const StereoRig& rig);

  // Adds a pair's matches, not gated by the rig: up to kOfPair of them, spread over the list. True when rig()
  // has changed.
  [[nodiscard]] bool add(std::span<const RigMatch> matches);
  // Before the first measurement: where the matches of one pair are too far off their lines for stereo, the
  // rig is corrected by them, once, except for the turn about y, which one pair does not determine. True when
  // rig() has changed.
  [[nodiscard]] bool correctAtStart(const std::vector<RigMatch>& matches);
  // Removes a range error from rig(), as withoutRangeError(). With lens distortion a wrong principal point
  // looks like a turn: the newest measurement is repeated.
  void correctRange(const RangeError& error);

  [[nodiscard]] const StereoRig& rig() const { return history_.rig(history_.newest()); }
  // Earlier versions; once the history is full the rig does not change any more.
  [[nodiscard]] const RigHistory& history() const { return history_; }
  // Total change: turn of the right camera about its x, y, z [rad], logarithm of right over left focal
  // length; and the sum of correctRange().
  [[nodiscard]] Eigen::Vector3d turned() const;
  [[nodiscard]] double focal() const { return focal_; }
  [[nodiscard]] const RangeError& rangeCorrected() const { return range_; }
  // Standard deviation of the turn about y by epipolar lines [rad]; infinite before the first measurement.
  [[nodiscard]] double yawSigma() const;
  // Number of changes beyond the tolerance of stereo: the rig was knocked, or differed from its calibration
  // at the start.
  [[nodiscard]] std::uint64_t changes() const { return changes_; }
  [[nodiscard]] std::uint64_t measurements() const { return measurements_; }
  // Resets of the estimate, its initialisation included.
  [[nodiscard]] std::uint64_t resets() const { return resets_; }
  // One sentence for the operator; std::nullopt without changes.
  [[nodiscard]] std::optional<std::string> warning() const;

  static constexpr std::size_t kOfPair = 256, kHeld = 2048, kToRefine = 4 * kHeld;

  // For saved state.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.history_, self.T_right_left_, self.focal_, self.range_.scale, self.range_.per_metre,
            self.changes_, self.measurements_, self.resets_, self.left_, self.known_, self.judged_off_);
    archive.bounded(self.matches_, kToRefine);
    archive.bounded(self.judged_, kToRefine);
  }

 private:
  [[nodiscard]] bool applyLeft(bool same);
  void apply(bool same);

  StereoRig calibrated_;
  RigHistory history_;
  SE3 T_right_left_;  // of rig(), without range_
  double focal_ = 0;
  RangeError range_;
  std::uint64_t changes_ = 0, measurements_ = 0, resets_ = 0;
  Eigen::Vector4d left_ = Eigen::Vector4d::Zero();   // estimated and not yet in rig()
  Eigen::Matrix4d known_ = Eigen::Matrix4d::Zero();  // information of the estimate, as EpipolarCheck has it
  std::vector<RigMatch> matches_, judged_;           // collected; of the newest measurement
  Eigen::Vector4d judged_off_ = Eigen::Vector4d::Zero();  // change of rig() by judged_
};

}  // namespace fathom::calibration
