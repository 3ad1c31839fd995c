#include "recon/calibration/rig_history.hpp"

#include <cmath>

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
  for (std::size_t k = 0; k < mesh.vertices.size(); ++k) {
    Eigen::Vector3f& vertex = mesh.vertices[k];
    const Eigen::Vector3f moved = retriangulated(from, to, vertex.cast<double>()).cast<float>();
    const float longer = moved.z() / vertex.z();  // sigma goes with the square of the range
    if (k < mesh.sigma.size()) mesh.sigma[k] *= longer * longer;
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
  return std::exp2(newest() / kDoubles);
}

void RigHistory::add(const StereoRig& rig, bool same) {
  if (!full()) versions_.push_back({rig, versions_.back().knocks + (same ? 0 : 1)});
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
  }
}

}  // namespace fathom::calibration
