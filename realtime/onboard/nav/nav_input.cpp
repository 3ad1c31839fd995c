#include "realtime/onboard/nav/nav_input.hpp"

#include <cassert>
#include <cstddef>

namespace fathom::onboard {
namespace {

// DVL: values 0-2 velocity, 3-6 ranges, 7 altitude, 8 sound speed.
constexpr std::uint8_t kVelocityPresent = 1, kAltitudePresent = 2, kFirstRangePresent = 4;
constexpr std::size_t kFirstRange = 3, kAltitude = 7, kDvlSoundSpeed = 8;
// Attitude: values 0 roll, 1 pitch, 2 heading.
constexpr std::uint8_t kMagnetic = 1;
// Gyro: values 0-2 rate about its axes, or 2 that of heading.
constexpr std::uint8_t kBodyRatePresent = 1, kHeadingRatePresent = 2;
// Depth: value 0. Water: value 0 sound speed.
constexpr std::uint8_t kSoundSpeedPresent = 1;

NavInput make(NavInput::Kind kind, std::int64_t utc_ns) noexcept {
  NavInput input;
  input.kind = kind;
  input.utc_ns = utc_ns;
  return input;
}

}  // namespace

NavInput navInput(const DvlSample& sample) noexcept {
  NavInput input = make(NavInput::Kind::kDvl, sample.utc_ns);
  unsigned present = 0;
  if (sample.velocity) {
    present |= kVelocityPresent;
    for (int i = 0; i < 3; ++i) input.values[static_cast<std::size_t>(i)] = (*sample.velocity)[i];
  }
  for (std::size_t beam = 0; beam < sample.range.size(); ++beam) {
    if (!sample.range[beam]) continue;
    present |= static_cast<unsigned>(kFirstRangePresent) << beam;
    input.values[kFirstRange + beam] = *sample.range[beam];
  }
  if (sample.altitude) {
    present |= kAltitudePresent;
    input.values[kAltitude] = *sample.altitude;
  }
  input.values[kDvlSoundSpeed] = sample.sound_speed;
  input.present = static_cast<std::uint8_t>(present);
  return input;
}

DvlSample dvlSample(const NavInput& input) noexcept {
  assert(input.kind == NavInput::Kind::kDvl);
  DvlSample sample;
  sample.utc_ns = input.utc_ns;
  if ((input.present & kVelocityPresent) != 0)
    sample.velocity = Eigen::Vector3d(input.values[0], input.values[1], input.values[2]);
  for (std::size_t beam = 0; beam < sample.range.size(); ++beam)
    if ((input.present & (static_cast<unsigned>(kFirstRangePresent) << beam)) != 0)
      sample.range[beam] = input.values[kFirstRange + beam];
  if ((input.present & kAltitudePresent) != 0) sample.altitude = input.values[kAltitude];
  sample.sound_speed = input.values[kDvlSoundSpeed];
  return sample;
}

NavInput navInput(const AttitudeSample& sample) noexcept {
  NavInput input = make(NavInput::Kind::kAttitude, sample.utc_ns);
  input.values[0] = sample.roll;
  input.values[1] = sample.pitch;
  input.values[2] = sample.heading;
  input.present = sample.magnetic ? kMagnetic : 0;
  return input;
}

AttitudeSample attitudeSample(const NavInput& input) noexcept {
  assert(input.kind == NavInput::Kind::kAttitude);
  return {input.utc_ns, input.values[0], input.values[1], input.values[2], (input.present & kMagnetic) != 0};
}

NavInput navInput(const GyroSample& sample) noexcept {
  NavInput input = make(NavInput::Kind::kGyro, sample.utc_ns);
  if (sample.body_rate) {
    input.present = kBodyRatePresent;
    for (int i = 0; i < 3; ++i) input.values[static_cast<std::size_t>(i)] = (*sample.body_rate)[i];
  } else if (sample.heading_rate) {
    input.present = kHeadingRatePresent;
    input.values[2] = *sample.heading_rate;
  }
  return input;
}

GyroSample gyroSample(const NavInput& input) noexcept {
  assert(input.kind == NavInput::Kind::kGyro);
  GyroSample sample;
  sample.utc_ns = input.utc_ns;
  if ((input.present & kBodyRatePresent) != 0)
    sample.body_rate = Eigen::Vector3d(input.values[0], input.values[1], input.values[2]);
  if ((input.present & kHeadingRatePresent) != 0) sample.heading_rate = input.values[2];
  return sample;
}

NavInput navInput(const DepthSample& sample) noexcept {
  NavInput input = make(NavInput::Kind::kDepth, sample.utc_ns);
  input.values[0] = sample.depth;
  return input;
}

DepthSample depthSample(const NavInput& input) noexcept {
  assert(input.kind == NavInput::Kind::kDepth);
  return {input.utc_ns, input.values[0]};
}

NavInput navInput(const WaterSample& sample) noexcept {
  NavInput input = make(NavInput::Kind::kWater, sample.utc_ns);
  if (sample.sound_speed) {
    input.present = kSoundSpeedPresent;
    input.values[0] = *sample.sound_speed;
  }
  return input;
}

WaterSample waterSample(const NavInput& input) noexcept {
  assert(input.kind == NavInput::Kind::kWater);
  WaterSample sample;
  sample.utc_ns = input.utc_ns;
  if ((input.present & kSoundSpeedPresent) != 0) sample.sound_speed = input.values[0];
  return sample;
}

NavInput frameInput(std::int64_t utc_ns, CameraSide side, std::uint32_t frame_id) noexcept {
  NavInput input = make(NavInput::Kind::kFrame, utc_ns);
  input.side = side;
  input.frame_id = frame_id;
  return input;
}

NavInput healthTickInput(std::int64_t utc_ns) noexcept {
  return make(NavInput::Kind::kHealthTick, utc_ns);
}

}  // namespace fathom::onboard
