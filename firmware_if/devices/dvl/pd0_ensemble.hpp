#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace fathom::io {

// What a Teledyne RDI PD0 ensemble says, in SI units except where a name says otherwise. Source: "WorkHorse
// Commands and Output Data Format" (TRDI P/N 957-6156), chapter "PD0 Output Data Format". Values that the
// instrument marks as bad, or that the ensemble does not carry, are std::nullopt.

inline constexpr std::size_t kPd0HeaderBytes = 6;
inline constexpr std::int16_t kBadPd0Velocity = -32768;  // on the wire, of PD4 and PD5 too: absent

// Frame of the velocities, bits 4-3 of the coordinate transform byte (EX command).
enum class Pd0Frame : std::uint8_t { kBeam = 0, kInstrument = 1, kShip = 2, kEarth = 3 };
// "beam", "instrument", "ship", "earth".
[[nodiscard]] const char* frameName(Pd0Frame frame);

// ID 0x0600. Ranges and velocities as sent: the bottom's velocity relative to the instrument. The four slots
// are, by frame: beam 1..4 (positive towards the transducer); instrument X, Y, Z, error; ship starboard,
// forward, up, error; earth east, north, up, error.
struct Pd0BottomTrack {
  std::array<std::optional<double>, 4> velocity;  // [m/s]; -32768 on the wire is absent
  std::array<std::optional<double>, 4> range;     // of each beam along the instrument's axis [m]; 0 is absent
  std::array<std::uint8_t, 4> correlation{};      // 0 to 255
  std::array<std::uint8_t, 4> percent_good{};

  // True when the three components of velocity (or, in beam frame, three beams) are there.
  [[nodiscard]] bool hasVelocity(Pd0Frame frame) const;
};

struct Pd0Ensemble {
  std::uint32_t number = 0;            // 24 bits on the wire
  std::optional<std::int64_t> utc_ns;  // the instrument's clock, taken as UTC; absent for an impossible date
  // Fixed leader (ID 0x0000).
  std::uint8_t firmware_version = 0;
  std::uint8_t firmware_revision = 0;
  std::uint16_t system_configuration = 0;
  bool up_looking = false;  // of the water profile's head
  bool tilts_used = false;  // bit 2 of the transform byte
  Pd0Frame frame = Pd0Frame::kBeam;
  double beam_angle = 0;         // from the instrument's axis [rad]; 0 when the ensemble does not say
  double heading_alignment = 0;  // EA [rad]
  double heading_bias = 0;       // EB [rad]
  std::uint8_t beams = 0;
  std::uint8_t cells = 0;  // of the water profile
  // Variable leader (ID 0x0080). Degrees, as a person and the CSV read them.
  std::optional<double> heading_deg;    // 0 to 359.99
  std::optional<double> pitch_deg;      // beam 3 higher than beam 4: positive
  std::optional<double> roll_deg;       // down-looking: beam 2 higher than beam 1: positive
  std::optional<double> sound_speed;    // that the instrument used [m/s]
  std::optional<double> temperature_c;  // [deg C]
  std::optional<double> salinity;       // [parts per thousand]
  std::optional<double> pressure;       // relative to one atmosphere [Pa]
  std::optional<Pd0BottomTrack> bottom_track;

  [[nodiscard]] bool hasBottomTrackVelocity() const {
    return bottom_track.has_value() && bottom_track->hasVelocity(frame);
  }
};

// Reads a whole ensemble with a right checksum: from its header (0x7F 0x7F) to the last data byte, without
// the checksum. Blocks of other IDs (water profiles, navigation, vendor's) are stepped over by the offset
// table. False without a fixed and a variable leader; then `out` is unspecified.
[[nodiscard]] bool readPd0Ensemble(std::span<const std::uint8_t> bytes, Pd0Ensemble& out) noexcept;

}  // namespace fathom::io
