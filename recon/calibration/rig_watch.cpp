#include "recon/calibration/rig_watch.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

namespace fathom::calibration {
namespace {

// Errors of neighbouring matches are correlated by image and lens: the information of a measurement is
// deflated by this factor.
constexpr double kCorrelation = 4;
// Random walk of a rig that warms, cools and settles, from one measurement to the next [rad], [1].
constexpr double kWalk = 2e-5;
// Gate of a measurement against the estimate: chi-square with 4 degrees of freedom, beyond what changes of
// distortion cause.
constexpr double kContradicts = 60;
// Smaller changes do not give a new rig: of ranges [1] at a survey's altitude [m], and of epipolar lines, as
// a turn [rad].
constexpr double kLeastRange = 5e-4, kSurveyRange = 2, kLeastTurn = 5e-5;

Eigen::Vector4d changeOf(const EpipolarCheck& check) {
  Eigen::Vector4d change;
  change << check.rotation, check.focal;
  return change;
}

}  // namespace

RigWatch::RigWatch(const StereoRig& rig) : calibrated_(rig), history_(rig), T_right_left_(rig.T_right_left) {
  matches_.reserve(kToRefine);
  judged_.reserve(kToRefine);
}

bool RigWatch::add(std::span<const RigMatch> matches) {
  if (history_.full()) return false;
  const std::size_t enough = resets_ > 0 ? kToRefine : kHeld;
  const std::size_t count = std::min({matches.size(), kOfPair, enough - matches_.size()});
  for (std::size_t k = 0; k < count; ++k) matches_.push_back(matches[k * matches.size() / count]);
  if (matches_.size() < enough) return false;
  const EpipolarCheck check = checkEpipolar(rig(), matches_);
  if (!measuresRig(check)) {
    matches_.clear();
    return false;
  }
  ++measurements_;
  judged_.swap(matches_);
  matches_.clear();
  const Eigen::Vector4d measured = changeOf(check);
  judged_off_ = measured;
  const Eigen::Matrix4d information = check.information / kCorrelation;
  const Eigen::Vector4d off = measured - left_;
  const bool moved = explainsMove(check);
  const bool contradicts =
      resets_ > 0 && off.dot((known_.inverse() + information.inverse()).ldlt().solve(off)) > kContradicts;
  const bool same =
      resets_ == 0 || (!moved && !contradicts);  // the first measurement is of the rig as it was
  if (moved && (resets_ > 0 || changes_ == 0)) ++changes_;
  if (moved || contradicts || resets_ == 0) {
    ++resets_;
    left_ = measured;
    known_ = information;
  } else {
    known_ = (known_.inverse() + kWalk * kWalk * Eigen::Matrix4d::Identity()).inverse();
    const Eigen::Matrix4d both = known_ + information;
    left_ = both.ldlt().solve(known_ * left_ + information * measured);
    known_ = both;
  }
  return applyLeft(same);
}

// False where the change is too small: the threshold grows with the number of versions, so that a dive of any
// length leaves room for a knock.
bool RigWatch::applyLeft(bool same) {
  const StereoRig to = changed(rig(), left_.head<3>(), left_.w());
  const double worth = history_.worth();
  if (history_.full() || (same && left_.cwiseAbs().maxCoeff() < worth * kLeastTurn &&
                          std::abs(rangeChange(rig(), to).at(kSurveyRange)) < worth * kLeastRange))
    return false;
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = left_.head<3>();
  T_right_left_ = SE3::exp(twist) * T_right_left_;
  focal_ += left_.w();
  judged_off_ -= left_;
  left_.setZero();
  apply(same);
  return true;
}

void RigWatch::correctRange(const RangeError& error) {
  range_.scale += error.scale;
  range_.per_metre += error.per_metre;
  apply(true);
  if (judged_.empty()) return;
  const Eigen::Vector4d measured = changeOf(checkEpipolar(rig(), judged_));
  left_ += measured - judged_off_;
  judged_off_ = measured;
  (void)applyLeft(true);
}

bool RigWatch::correctAtStart(const std::vector<RigMatch>& matches) {
  constexpr std::size_t kFewest = 100;  // of one pair: too few for cells of the image
  constexpr double kExplained = 0.5;
  if (resets_ > 0 || history_.newest() > 0) return false;
  // Decided for most pairs without memory from the heap.
  constexpr double kOffLine = 0.33;  // median |error| of matches with a sigma of kMostMedian [px]
  const auto off_line = std::ranges::count_if(
      matches, [&](const RigMatch& match) { return std::abs(epipolarError(rig(), match)) > kOffLine; });
  if (4 * static_cast<std::size_t>(off_line) < matches.size()) return false;
  const EpipolarCheck check = checkEpipolar(rig(), matches);
  const double off = std::max(std::abs(check.median), check.sigma);
  if (!measuresRig(check, kFewest) || off < kMostMedian || check.sigma_after > kExplained * off) return false;
  left_ = {check.rotation.x(), 0, check.rotation.z(), check.focal};
  ++changes_;
  return applyLeft(true);
}

Eigen::Vector3d RigWatch::turned() const {
  return (T_right_left_ * calibrated_.T_right_left.inverse()).log().tail<3>();
}

double RigWatch::yawSigma() const {
  return resets_ == 0 ? std::numeric_limits<double>::infinity() : std::sqrt(known_.inverse()(1, 1));
}

std::optional<std::string> RigWatch::warning() const {
  if (changes_ == 0) return std::nullopt;
  return "the rig does not stand as it was calibrated: the map takes " + describeChange(turned(), focal_) +
         "; fathom-topside check-calibration MISSION --mended stereo.calib makes the file for the next dive";
}

void RigWatch::apply(bool same) {
  StereoRig turned = changed(calibrated_, Eigen::Vector3d::Zero(), focal_);
  turned.T_right_left = T_right_left_;
  history_.add(withoutRangeError(turned, range_), same);
}

}  // namespace fathom::calibration
