#include "recon/calibration/rig_history.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/numbers/portable_math.hpp"

namespace fathom::calibration {

Eigen::Vector3d retriangulated(const StereoRig& from, const StereoRig& to, const Eigen::Vector3d& point) {
  const Eigen::Vector3d right = from.T_right_left * point;
  Eigen::Vector3d out;
  double gap = 0;
  if (!(point.z() > 0) || !(right.z() > 0) ||
      !triangulatePixels(to, from.left.project(point), from.right.project(right), out, gap))
    return point;
  return out;
}

void retriangulate(const StereoRig& from, const StereoRig& to, Mesh& mesh) {
  const auto shorter = static_cast<float>(from.baseline() / to.baseline());
  for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
    Eigen::Vector3f& vertex = mesh.vertices[k];
    const Eigen::Vector3f moved = retriangulated(from, to, vertex.cast<double>()).cast<float>();
    const float longer = moved.z() / vertex.z();  // sigma goes with the square of the range over the baseline
    if (k < mesh.sigma.size()) mesh.sigma[k] *= longer * longer * shorter;
    vertex = moved;
  }
}

RangeError rangeChange(const StereoRig& from, const StereoRig& to) {
  constexpr double kNear = 1, kFar = 3;  // [m]
  const auto grown = [&](double z) { return std::log(retriangulated(from, to, {0, 0, z}).z() / z); };
  const double near = grown(kNear), per_metre = (grown(kFar) - near) / (kFar - kNear);
  return {near - per_metre * kNear, per_metre};
}

StereoRig withoutRangeError(const StereoRig& rig, const RangeError& error) {
  StereoRig out = rig;
  // z = f b / d: a disparity that is larger by b * per_metre * f makes z (1 - per_metre * z).
  const double angle = error.per_metre * rig.baseline();
  Vector6d twist = Vector6d::Zero();
  if (rig.right.port)
    twist(4) = angle;  // principal points of a camera behind a port are the port's
  else
    out.right.cx += angle * rig.right.fx;
  out.T_right_left = SE3::exp(twist) * SE3(rig.T_right_left.rotation(),
                                           std::exp(-error.scale) * rig.T_right_left.translation());
  return out;
}

RigHistory::RigHistory(const StereoRig& rig) : calibrated_(rig) {
  versions_.reserve(kMost);
  versions_.push_back({rig, 0});
}

double RigHistory::worth() const {
  constexpr double kDoubles = 8;  // versions
  return powerOfTwo(newest() / kDoubles);
}

int RigHistory::best(int version) const {
  const int knocks = versions_[static_cast<std::size_t>(version)].knocks;
  int last = newest();
  while (versions_[static_cast<std::size_t>(last)].knocks != knocks) --last;
  return last;
}

void RigHistory::restore() {
  for (Version& version : versions_) {
    const StereoRig known = version.rig;
    version.rig = calibrated_;
    version.rig.T_right_left = known.T_right_left;
    version.rig.left.fx = known.left.fx, version.rig.left.fy = known.left.fy;
    version.rig.right.fx = known.right.fx, version.rig.right.fy = known.right.fy;
    version.rig.right.cx = known.right.cx;
    version.rig.left.k1 = known.left.k1, version.rig.right.k1 = known.right.k1;
  }
}

namespace {

// Errors of neighbouring matches are correlated by image and lens: the information of a measurement is
// deflated by this factor.
constexpr double kCorrelation = 4;
// Random walk of a rig that warms, cools and settles, from one measurement to the next [rad], [1].
constexpr double kWalk = 2e-5;
// Gate of a measurement against the estimate: chi-square with 5 degrees of freedom, beyond what changes of
// distortion cause.
constexpr double kContradicts = 60;
// Smaller changes do not give a new rig: of ranges [1] at a survey's altitude [m], and of epipolar lines, as
// a turn [rad].
constexpr double kLeastRange = 5e-4, kSurveyRange = 2, kLeastTurn = 5e-5;

// As much as a turn moves lines, a coefficient moves them at the edge of the image.
constexpr double kAtEdge = 0.03;

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
  const RigChange::Vector measured = check.change.vector();
  judged_off_ = measured;
  const RigChange::Matrix information = check.information / kCorrelation;
  const RigChange::Vector off = measured - left_;
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
    known_ = (known_.inverse() + kWalk * kWalk * RigChange::Matrix::Identity()).inverse();
    const RigChange::Matrix both = known_ + information;
    left_ = both.ldlt().solve(known_ * left_ + information * measured);
    known_ = both;
  }
  return applyLeft(same);
}

// False where the change is too small: the threshold grows with the number of versions, so that a dive of any
// length leaves room for a knock.
bool RigWatch::applyLeft(bool same) {
  const RigChange by(left_);
  const StereoRig to = changed(rig(), by);
  RigChange::Vector moves = left_;
  moves(4) *= kAtEdge;
  const double worth = history_.worth();
  if (history_.full() || (same && moves.cwiseAbs().maxCoeff() < worth * kLeastTurn &&
                          std::abs(rangeChange(rig(), to).at(kSurveyRange)) < worth * kLeastRange))
    return false;
  Vector6d twist = Vector6d::Zero();
  twist.tail<3>() = by.rotation;
  T_right_left_ = SE3::exp(twist) * T_right_left_;
  focal_ += by.focal;
  radial_ += by.radial;
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
  const RigChange::Vector measured = checkEpipolar(rig(), judged_).change.vector();
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
  left_ = check.change.vector();
  left_.y() = 0;
  ++changes_;
  return applyLeft(true);
}

RigChange RigWatch::change() const {
  return {(T_right_left_ * calibrated_.T_right_left.inverse()).log().tail<3>(), focal_, radial_};
}

double RigWatch::yawSigma() const {
  return resets_ == 0 ? std::numeric_limits<double>::infinity() : std::sqrt(known_.inverse()(1, 1));
}

std::optional<std::string> RigWatch::warning() const {
  if (changes_ == 0) return std::nullopt;
  return "the rig does not stand as it was calibrated: the map takes " + describeChange(change()) +
         "; fathom-topside check-calibration MISSION --mended stereo.calib makes the file for the next dive";
}

void RigWatch::apply(bool same) {
  StereoRig turned = changed(calibrated_, {Eigen::Vector3d::Zero(), focal_, radial_});
  turned.T_right_left = T_right_left_;
  history_.add(withoutRangeError(turned, range_), same);
}

}  // namespace fathom::calibration
