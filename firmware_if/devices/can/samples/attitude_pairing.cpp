#include "firmware_if/devices/can/samples/attitude_pairing.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

namespace fathom::io {
namespace {

// Interpolates an angle in the direction of the smaller turn.
double interpolateAngle(double from, double to, double fraction) {
  return std::remainder(from + fraction * std::remainder(to - from, 2 * std::numbers::pi),
                        2 * std::numbers::pi);
}

}  // namespace

bool AttitudePairing::sameInstant(const Heading& heading, const Tilt& tilt) const noexcept {
  return tilt_sid_moves_ && heading_sid_moves_ && heading.sid && heading.sid == tilt.sid &&
         heading.source == tilt.source && std::abs(heading.utc_ns - tilt.utc_ns) <= max_gap_ns_;
}

void AttitudePairing::give(const Heading& heading, std::int64_t utc_ns, double roll, double pitch) noexcept {
  if (last_given_ns_ && utc_ns <= *last_given_ns_) {
    ++unpaired_;
    return;
  }
  last_given_ns_ = utc_ns;
  out_[out_count_++] = {utc_ns, roll, pitch, heading.heading, heading.magnetic};
}

std::span<const AttitudeSample> AttitudePairing::add(const Heading& heading) noexcept {
  out_count_ = 0;
  heading_sid_moves_ = heading.sid && last_heading_sid_ && heading.sid != last_heading_sid_;
  last_heading_sid_ = heading.sid;
  if (tilt_ && sameInstant(heading, *tilt_)) {
    unpaired_ += waiting_count_;
    waiting_count_ = 0;
    give(heading, std::min(heading.utc_ns, tilt_->utc_ns), tilt_->roll, tilt_->pitch);
    return {out_.data(), out_count_};
  }
  if (waiting_count_ == kWaiting) {
    ++unpaired_;
    std::shift_left(waiting_.begin(), waiting_.end(), 1);
    --waiting_count_;
  }
  waiting_[waiting_count_++] = heading;
  return {};
}

std::span<const AttitudeSample> AttitudePairing::add(const Tilt& tilt) noexcept {
  out_count_ = 0;
  tilt_sid_moves_ = tilt.sid && tilt_ && tilt.sid != tilt_->sid;
  for (std::size_t i = 0; i < waiting_count_; ++i) {
    const Heading& heading = waiting_[i];
    if (sameInstant(heading, tilt)) {
      give(heading, std::min(heading.utc_ns, tilt.utc_ns), tilt.roll, tilt.pitch);
    } else if (heading.utc_ns == tilt.utc_ns) {
      give(heading, heading.utc_ns, tilt.roll, tilt.pitch);
    } else if (tilt_ && tilt_->utc_ns <= heading.utc_ns && heading.utc_ns < tilt.utc_ns &&
               tilt.utc_ns - tilt_->utc_ns <= max_gap_ns_) {
      const double fraction = static_cast<double>(heading.utc_ns - tilt_->utc_ns) /
                              static_cast<double>(tilt.utc_ns - tilt_->utc_ns);
      give(heading, heading.utc_ns, interpolateAngle(tilt_->roll, tilt.roll, fraction),
           interpolateAngle(tilt_->pitch, tilt.pitch, fraction));
    } else {
      ++unpaired_;
    }
  }
  waiting_count_ = 0;
  tilt_ = tilt;
  return {out_.data(), out_count_};
}

}  // namespace fathom::io
