#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <variant>

#include "realtime/base/files/file_name.hpp"

namespace fathom {

// Plain samples that sensors give, shared by devices, simulator and navigation. Time: ns since the Unix
// epoch, UTC, at which the quantity was true (not when it arrived). Absent values are std::nullopt, never a
// number.

// One bottom-track ensemble.
struct DvlSample {
  std::int64_t utc_ns = 0;
  // Velocity of the instrument over the ground in the DVL frame (forward, starboard, down when T_body_dvl is
  // identity) [m/s]; as computed with `sound_speed`. PD0 sends the bottom's velocity: the opposite sign.
  std::optional<Eigen::Vector3d> velocity;
  std::array<std::optional<double>, 4> range;  // along each beam's vertical projection [m]
  std::optional<double> altitude;              // instrument to bottom, vertical [m]
  double sound_speed = 1500.0;                 // that the instrument assumed [m/s]
};

// Tilt-compensated compass or gyro compass: attitude of the compass frame.
struct AttitudeSample {
  std::int64_t utc_ns = 0;
  double roll = 0;     // [rad]
  double pitch = 0;    // [rad]
  double heading = 0;  // [rad], from magnetic north if `magnetic`, else true north
  bool magnetic = true;
};

// Rate of turn. One of the two values is present.
struct GyroSample {
  std::int64_t utc_ns = 0;
  // About the gyro's axes (forward, starboard, down when T_body_compass is identity: gyro and compass are
  // taken for one instrument) [rad/s].
  std::optional<Eigen::Vector3d> body_rate;
  std::optional<double> heading_rate;  // of an instrument without the others; to starboard positive [rad/s]
};

struct DepthSample {
  std::int64_t utc_ns = 0;
  double depth = 0;  // of the pressure sensor below the surface [m]
};

// Position of the vehicle's transponder as the ship's USBL computed it.
struct UsblFix {
  std::int64_t utc_ns = 0;          // of the ping, not of the fix's arrival
  std::int64_t arrival_utc_ns = 0;  // when the vehicle receives it (over the modem)
  double latitude = 0;              // [rad]
  double longitude = 0;             // [rad]
  double depth = 0;                 // [m]
  double sigma_horizontal = 0;      // of either horizontal component [m]
};

struct GpsFix {
  std::int64_t utc_ns = 0;
  double latitude = 0;          // [rad]
  double longitude = 0;         // [rad]
  double sigma_horizontal = 0;  // of either horizontal component [m]
};

struct WaterSample {
  std::int64_t utc_ns = 0;
  std::optional<double> conductivity;  // [S/m]
  std::optional<double> temperature;   // [deg C]
  std::optional<double> sound_speed;   // derived [m/s]
  std::optional<double> chlorophyll;   // [ug/l]
  std::optional<double> cdom;          // [ppb]
  std::optional<double> turbidity;     // optical backscatter [1/m/sr]
};

// State of the vehicle's main battery, from its management system.
struct BatterySample {
  std::int64_t utc_ns = 0;
  std::optional<double> voltage;  // [V]
  std::optional<double> current;  // out of the battery [A]
  std::optional<double> charge;   // left, 0 to 1
};

// Progress of the mission, from the vehicle's own mission control.
struct MissionProgressSample {
  std::int64_t utc_ns = 0;
  double fraction = 0;  // 0 to 1
};

enum class CameraSide : std::uint8_t { kLeft = 0, kRight = 1 };

// One exposure; the pixels are in the file (or, live, in a frame pool).
struct ImageEvent {
  std::int64_t utc_ns = 0;  // of the exposure by the camera's clock, offset corrected as far as known
  CameraSide side = CameraSide::kLeft;
  FileName file_name;  // within img/
  double exposure_s = 0;
};

// Nothing that owns memory: copying a sample never throws and never calls the heap.
using SensorSample = std::variant<DvlSample, AttitudeSample, DepthSample, UsblFix, GpsFix, WaterSample,
                                  BatterySample, MissionProgressSample, GyroSample, ImageEvent>;
// Number of kinds that devices other than cameras give.
inline constexpr std::size_t kDeviceKinds = std::variant_size_v<SensorSample> - 1;

}  // namespace fathom
