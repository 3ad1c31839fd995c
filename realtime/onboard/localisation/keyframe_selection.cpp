#include "realtime/onboard/localisation/keyframe_selection.hpp"

namespace fathom::onboard {
namespace {

constexpr double kNanoseconds = 1e9;  // in a second

}  // namespace

bool KeyframeSelection::take(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                             bool trusted) {
  if (last_ && trusted) {
    const double apart = (seen.centre - last_->seen.centre).norm();
    const double reach =
        closure::separationOfOverlap(config_.keyframe_overlap) * 0.5 * (seen.radius + last_->seen.radius);
    const double turn = T_odom_cam.rotation().angularDistance(last_->T_odom_cam.rotation());
    const double since = static_cast<double>(utc_ns - last_->utc_ns) / kNanoseconds;
    if (apart < reach && turn < config_.keyframe_turn && since < config_.keyframe_s) return false;
  }
  last_ = {utc_ns, T_odom_cam, seen};
  return true;
}

}  // namespace fathom::onboard
