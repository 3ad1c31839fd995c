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

// The rig's turn and ratio of focal lengths as states, estimated pair after pair in fixed memory from how far
// matches lie off their epipolar lines. Matches are held until they fill the view; checkEpipolar() of them is
// one measurement, with its covariance, of what is left; the estimate is the information-weighted mean of
// all, with a slow random walk, and the rig is changed to it. A measurement that contradicts the estimate
// beyond chance shows a rig that was knocked: the estimate begins anew. The turn about y, which makes all
// ranges wrong, shows least in epipolar lines; range errors that DVL and visual odometry find between them
// are taken out beside it (correctRange).
class RigWatch {
 public:
  explicit RigWatch(const StereoRig& rig);

  // A pair's matches, before they are judged by the rig: up to kOfPair of them, spread over the list. True
  // when rig() has changed.
  [[nodiscard]] bool add(std::span<const RigMatch> matches);
  // Before the first measurement: where the matches of one pair show that stereo cannot do with the rig as it
  // was calibrated, it is changed to what they show, once, but for the turn about y, which one pair does not
  // tell. True when rig() has changed.
  [[nodiscard]] bool standAsShown(const std::vector<RigMatch>& matches);
  // Takes a range error out of rig(), as withoutRangeError(). Lenses that distort let a wrong principal point
  // seem a turn: the newest measurement is taken anew.
  void correctRange(const RangeError& error);

  [[nodiscard]] const StereoRig& rig() const { return history_.rig(history_.newest()); }
  // What it was taken for before; it changes no more once that is full.
  [[nodiscard]] const RigHistory& history() const { return history_; }
  // By how much in all: of the right camera about its x, y, z [rad], and the logarithm of right over left
  // focal length; and what correctRange() took out.
  [[nodiscard]] Eigen::Vector3d turned() const;
  [[nodiscard]] double focal() const { return focal_; }
  [[nodiscard]] const RangeError& rangeCorrected() const { return range_; }
  // Standard deviation of the turn about y that epipolar lines leave [rad]; infinite before the first
  // measurement.
  [[nodiscard]] double yawSigma() const;
  // Times that matches contradicted the rig beyond what stereo can do with: it was knocked, or stood
  // otherwise from the start.
  [[nodiscard]] std::uint64_t changes() const { return changes_; }
  // Measurements so far.
  [[nodiscard]] std::uint64_t measurements() const { return measurements_; }
  // Times that the estimate began anew, the first time included.
  [[nodiscard]] std::uint64_t beginnings() const { return beginnings_; }
  // One sentence for people; none while it stands as it was calibrated.
  [[nodiscard]] std::optional<std::string> warning() const;

  static constexpr std::size_t kOfPair = 256, kHeld = 2048, kToRefine = 4 * kHeld;

  // For saved state.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.history_, self.T_right_left_, self.focal_, self.range_.scale, self.range_.per_metre,
            self.changes_, self.measurements_, self.beginnings_, self.left_, self.known_, self.judged_off_);
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
  std::uint64_t changes_ = 0, measurements_ = 0, beginnings_ = 0;
  Eigen::Vector4d left_ = Eigen::Vector4d::Zero();   // estimated but too small to be worth a change
  Eigen::Matrix4d known_ = Eigen::Matrix4d::Zero();  // information of the estimate, as EpipolarCheck has it
  std::vector<RigMatch> matches_, judged_;           // that wait; of the newest measurement
  Eigen::Vector4d judged_off_ = Eigen::Vector4d::Zero();  // what judged_ says of rig()
};

}  // namespace fathom::calibration
