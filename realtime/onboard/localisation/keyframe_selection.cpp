#include "realtime/onboard/localisation/keyframe_selection.hpp"

#include "realtime/base/units.hpp"

namespace fathom::onboard {
namespace {}  // namespace

bool KeyframeSelection::due(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                            bool reliable, const Slack& slack) const {
  if (!last_ || !reliable) return true;
  const double apart = (seen.centre - last_->seen.centre).norm() + slack.metres;
  const double reach =
      closure::separationOfOverlap(config_.keyframe_overlap) * 0.5 * (seen.radius + last_->seen.radius);
  const double turn = T_odom_cam.rotation().angularDistance(last_->T_odom_cam.rotation()) + slack.radians;
  const double since = static_cast<double>(utc_ns - last_->utc_ns) / kNanosecondsPerSecond;
  return apart >= reach || turn >= config_.keyframe_turn || since >= config_.keyframe_s;
}

bool KeyframeSelection::take(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                             bool reliable) {
  if (!due(utc_ns, T_odom_cam, seen, reliable)) return false;
  last_ = {utc_ns, T_odom_cam, seen};
  return true;
}

}  // namespace fathom::onboard
