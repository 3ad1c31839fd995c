#include "recon/calibration/rig_watch.hpp"

#include <algorithm>

namespace fathom::calibration {

RigWatch::RigWatch(const StereoRig& rig) : calibrated_(rig), rig_(rig), T_right_left_(rig.T_right_left) {
  matches_.reserve(kToRefine);
}

bool RigWatch::add(std::span<const RigMatch> matches) {
  const std::size_t enough = refining_ ? kToRefine : kHeld;
  const std::size_t count = std::min({matches.size(), kOfPair, enough - matches_.size()});
  for (std::size_t k = 0; k < count; ++k) matches_.push_back(matches[k * matches.size() / count]);
  if (matches_.size() < enough) return false;
  const EpipolarCheck check = checkEpipolar(rig_, matches_);
  matches_.clear();
  const bool moved = explainsMove(check);
  const bool refines = refining_ && check.sigma_after < kMostMedian;  // not matches of nothing
  refining_ = moved;
  if (!moved && !refines) return false;
  if (moved) ++changes_;
  T_right_left_ = changed(rig_, check.rotation, 0).T_right_left;
  focal_ += check.focal;
  apply();
  return true;
}

Eigen::Vector3d RigWatch::turned() const {
  return (T_right_left_ * calibrated_.T_right_left.inverse()).log().tail<3>();
}

std::optional<std::string> RigWatch::warning() const {
  if (changes_ == 0) return std::nullopt;
  return "the rig does not stand as it was calibrated: the map takes " + describeChange(turned(), focal_) +
         "; fathom-topside check-calibration MISSION --mended stereo.calib makes the file for the next dive";
}

void RigWatch::apply() {
  rig_ = changed(calibrated_, Eigen::Vector3d::Zero(), focal_);
  rig_.T_right_left = T_right_left_;
}

}  // namespace fathom::calibration
