#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/calibration/sensor_checks.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// Relative error of a rig's ranges, as a logarithm, positive where they are too long: scale + per_metre *
// range. A wrong baseline causes the first; a turn towards the other camera, and principal points, the
// second.
struct RangeError {
  double scale = 0;      // [1]
  double per_metre = 0;  // [1/m]
  [[nodiscard]] double at(double range) const { return scale + per_metre * range; }
};

// Growth of ranges when the same matches are triangulated by `to` instead of `from`: in the middle of the
// image, at ranges of a survey.
[[nodiscard]] RangeError rangeChange(const StereoRig& from, const StereoRig& to);
// The rig with its baseline and its right principal point changed so that its ranges are free of `error`.
[[nodiscard]] StereoRig withoutRangeError(const StereoRig& rig, const RangeError& error);

// Triangulates the pixels of `point`, a point by `from`, by `to`: left camera frame [m]. `point` itself where
// the rays do not meet.
[[nodiscard]] Eigen::Vector3d retriangulated(const StereoRig& from, const StereoRig& to,
                                             const Eigen::Vector3d& point);
// The same for all vertices of a mesh, with their standard deviations along z.
void retriangulate(const StereoRig& from, const StereoRig& to, Mesh& mesh);

// Versions of the estimated rig, so that points triangulated by an earlier version can be triangulated again.
// Fixed memory.
class RigHistory {
 public:
  static constexpr std::size_t kMost = 64;

  explicit RigHistory(const StereoRig& rig);

  // Factor on the threshold of a change of the same rig, relative to the first: it doubles every few
  // versions.
  [[nodiscard]] double worth() const;
  [[nodiscard]] bool full() const { return versions_.size() == kMost; }
  // Adds the rig from now on; `same`: the rig did not change, its estimate did. No effect when full.
  void add(const StereoRig& rig, bool same) {
    if (!full()) versions_.push_back({rig, versions_.back().knocks + (same ? 0 : 1)});
  }

  [[nodiscard]] int newest() const { return static_cast<int>(versions_.size()) - 1; }
  [[nodiscard]] const StereoRig& rig(int version) const {
    return versions_[static_cast<std::size_t>(version)].rig;
  }
  // The newest version without a knock since `version`: the best estimate of the rig at that time.
  [[nodiscard]] int best(int version) const;

  // For saved state; of a rig with the same calibration.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.bounded(self.versions_, kMost);
    archive.require(!self.versions_.empty(), "a rig without versions");
    if constexpr (Archive::kLoading) self.restore();
  }

 private:
  struct Version {
    StereoRig rig;
    int knocks = 0;  // before this version

    static void exchange(auto& archive, auto& self) {
      archive(self.rig.T_right_left, self.rig.left.fx, self.rig.left.fy, self.rig.right.fx, self.rig.right.fy,
              self.rig.right.cx, self.rig.left.k1, self.rig.right.k1, self.knocks);
    }
  };
  void restore();

  StereoRig calibrated_;
  std::vector<Version> versions_;
};

// Estimates the rig's change (RigChange) pair after pair, in fixed memory, from epipolar errors
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
  // Total change; and the sum of correctRange().
  [[nodiscard]] RigChange change() const;
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
  static void exchange(auto& archive, auto& self) {
    archive(self.history_, self.T_right_left_, self.focal_, self.radial_, self.range_.scale,
            self.range_.per_metre, self.changes_, self.measurements_, self.resets_, self.left_, self.known_,
            self.judged_off_);
    archive.bounded(self.matches_, kToRefine);
    archive.bounded(self.judged_, kToRefine);
  }

 private:
  [[nodiscard]] bool applyLeft(bool same);
  void apply(bool same);

  StereoRig calibrated_;
  RigHistory history_;
  SE3 T_right_left_;  // of rig(), without range_
  double focal_ = 0, radial_ = 0;
  RangeError range_;
  std::uint64_t changes_ = 0, measurements_ = 0, resets_ = 0;
  RigChange::Vector left_ = RigChange::Vector::Zero();  // estimated and not yet in rig()
  // Information of the estimate, as EpipolarCheck has it.
  RigChange::Matrix known_ = RigChange::Matrix::Zero();
  std::vector<RigMatch> matches_, judged_;                    // collected; of the newest measurement
  RigChange::Vector judged_off_ = RigChange::Vector::Zero();  // change of rig() by judged_
};

}  // namespace fathom::calibration
