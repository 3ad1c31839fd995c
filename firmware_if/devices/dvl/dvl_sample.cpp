#include "firmware_if/devices/dvl/dvl_sample.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

// Turns vectors of the DVL frame (forward, starboard, down) into north, east, down. The tilt sensors read the
// angle of the instrument's axes against the horizontal, so the rotation's pitch is atan(tan(pitch)
// cos(roll)).
std::optional<Eigen::Matrix3d> attitude(const Pd0Ensemble& ensemble) {
  if (!ensemble.heading_deg || !ensemble.pitch_deg || !ensemble.roll_deg) return std::nullopt;
  const double roll = *ensemble.roll_deg * kRadiansPerDegree;
  const double pitch = std::atan(std::tan(*ensemble.pitch_deg * kRadiansPerDegree) * std::cos(roll));
  const double heading = *ensemble.heading_deg * kRadiansPerDegree;
  return (Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

// The bottom's velocity as starboard, forward, up of the instrument.
std::optional<Eigen::Vector3d> starboardForwardUp(const Pd0Ensemble& ensemble, const Pd0BottomTrack& track) {
  const auto& v = track.velocity;
  if (!v[0] || !v[1] || !v[2]) return std::nullopt;
  const bool fixed_to_head = ensemble.frame == Pd0Frame::kBeam || ensemble.frame == Pd0Frame::kInstrument;
  if (fixed_to_head && ensemble.up_looking) return std::nullopt;
  switch (ensemble.frame) {
    case Pd0Frame::kBeam: {
      if (!v[3] || ensemble.beam_angle <= 0) return std::nullopt;
      const double across = 2 * std::sin(ensemble.beam_angle);
      const double along = 4 * std::cos(ensemble.beam_angle);
      return Eigen::Vector3d{(*v[0] - *v[1]) / across, (*v[3] - *v[2]) / across,
                             (*v[0] + *v[1] + *v[2] + *v[3]) / along};
    }
    case Pd0Frame::kInstrument:
    case Pd0Frame::kShip:
      return Eigen::Vector3d{*v[0], *v[1], *v[2]};
    case Pd0Frame::kEarth: {
      const auto R_nav_dvl = attitude(ensemble);
      if (!R_nav_dvl) return std::nullopt;
      const Eigen::Vector3d forward_starboard_down =
          R_nav_dvl->transpose() * Eigen::Vector3d{*v[1], *v[0], -*v[2]};
      return Eigen::Vector3d{forward_starboard_down.y(), forward_starboard_down.x(),
                             -forward_starboard_down.z()};
    }
  }
  return std::nullopt;
}

std::optional<double> altitude(const Pd0Ensemble& ensemble, const Pd0BottomTrack& track) {
  const auto R_nav_dvl = attitude(ensemble);
  if (!R_nav_dvl) return std::nullopt;
  const double cos_tilt = (*R_nav_dvl)(2, 2);
  if (cos_tilt <= 0) return std::nullopt;
  double sum = 0;
  int pairs = 0;
  for (const std::size_t beam : {0U, 2U}) {
    const auto& a = track.range[beam];
    const auto& b = track.range[beam + 1];
    if (!a || !b) continue;
    sum += 2 * cos_tilt / (1 / *a + 1 / *b);
    ++pairs;
  }
  if (pairs == 0) return std::nullopt;
  return sum / pairs;
}

}  // namespace

std::optional<DvlSample> toDvlSample(const Pd0Ensemble& ensemble) {
  if (!ensemble.utc_ns || !ensemble.bottom_track) return std::nullopt;
  DvlSample sample;
  sample.utc_ns = *ensemble.utc_ns;
  if (const auto bottom = starboardForwardUp(ensemble, *ensemble.bottom_track)) {
    sample.velocity = Eigen::Vector3d{-bottom->y(), -bottom->x(), bottom->z()};
  }
  sample.range = ensemble.bottom_track->range;
  sample.altitude = altitude(ensemble, *ensemble.bottom_track);
  if (ensemble.sound_speed) sample.sound_speed = *ensemble.sound_speed;
  return sample;
}

}  // namespace fathom::io
