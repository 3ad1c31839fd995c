#include "realtime/onboard/localisation/keyframe_selection.hpp"

#include <algorithm>

namespace fathom::onboard {
namespace {

constexpr double kNanoseconds = 1e9;    // in a second
constexpr double kThinningFrom = 0.25;  // of all keyframes left
constexpr double kThinnest = 1.0 / 3;   // of the configured share, with none left

}  // namespace

double KeyframeSelection::room() const {
  const double left = 1 - static_cast<double>(taken_) / config_.max_keyframes;
  return std::clamp(left / kThinningFrom, 0.0, 1.0);
}

double KeyframeSelection::overlap() const {
  return config_.keyframe_overlap * (kThinnest + (1 - kThinnest) * room());
}

bool KeyframeSelection::take(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                             bool trusted) {
  if (taken_ >= config_.max_keyframes) return false;
  const bool forced = !trusted && room() >= 1;
  if (last_ && !forced) {
    const double apart = (seen.centre - last_->seen.centre).norm();
    const double reach = closure::separationOfOverlap(overlap()) * 0.5 * (seen.radius + last_->seen.radius);
    const double turn = T_odom_cam.rotation().angularDistance(last_->T_odom_cam.rotation());
    const double since = static_cast<double>(utc_ns - last_->utc_ns) / kNanoseconds;
    if (apart < reach && turn < config_.keyframe_turn && since < config_.keyframe_s) return false;
  }
  last_ = {utc_ns, T_odom_cam, seen};
  ++taken_;
  return true;
}

}  // namespace fathom::onboard
