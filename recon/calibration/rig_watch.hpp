#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/calibration/epipolar_check.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// Whether the rig stands as it was calibrated, pair after pair, in fixed memory: a tenth of a degree puts
// every match off its epipolar line, and stereo drops it. Matches are held until they fill the view, then
// checkEpipolar() judges them; where the rig has moved it is changed, once more by four times as many (the
// turn towards the left camera, which makes all ranges wrong, shows least), and watched on from there.
class RigWatch {
 public:
  explicit RigWatch(const StereoRig& rig);

  // A pair's matches, before they are judged by the rig: up to kOfPair of them, spread over the list. True
  // when rig() has changed.
  [[nodiscard]] bool add(std::span<const RigMatch> matches);

  [[nodiscard]] const StereoRig& rig() const { return rig_; }
  // By how much in all: of the right camera about its x, y, z [rad], and the logarithm of right over left
  // focal length.
  [[nodiscard]] Eigen::Vector3d turned() const;
  [[nodiscard]] double focal() const { return focal_; }
  [[nodiscard]] std::uint64_t changes() const { return changes_; }
  // One sentence for people; none while it stands as it was calibrated.
  [[nodiscard]] std::optional<std::string> warning() const;

  static constexpr std::size_t kOfPair = 256, kHeld = 2048, kToRefine = 4 * kHeld;

  // For saved state.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.T_right_left_, self.focal_, self.changes_, self.refining_);
    archive.bounded(self.matches_, kToRefine);
    if constexpr (Archive::kLoading) self.apply();
  }

 private:
  void apply();

  StereoRig calibrated_, rig_;
  SE3 T_right_left_;  // of rig_
  double focal_ = 0;
  std::uint64_t changes_ = 0;
  bool refining_ = false;
  std::vector<RigMatch> matches_;
};

}  // namespace fathom::calibration
