#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "firmware_if/devices/dvl/ensemble_stream.hpp"
#include "firmware_if/devices/dvl/pd0_ensemble.hpp"

namespace fathom::io {

// The short binary outputs PD4 (47 bytes) and PD5 (88 bytes: PD4 and attitude, salinity, depth, distances).
// Source: "Pathfinder DVL Guide" (TRDI P/N 957-6172), "Special Output Data Formats"; the same in the guides
// of Workhorse Navigator and Explorer. 0x7D, structure (0: PD4, 1: PD5), length without the checksum, fields,
// checksum: the sum of all bytes before it modulo 65536.
//
// Velocities are the instrument's over a bottom at rest, the opposite of PD0's; the time of day has no date.
struct Pd45Ensemble {
  bool pd5 = false;
  Pd0Frame frame = Pd0Frame::kBeam;
  bool tilts_used = false;
  std::array<std::optional<double>, 4> velocity;  // as sent [m/s]
  std::array<std::optional<double>, 4> range;     // vertical, not corrected for tilt [m]
  std::optional<std::int64_t> time_of_day_ns;     // of the first ping
  std::optional<double> sound_speed;              // [m/s]
  std::optional<double> temperature_c;
  std::optional<double> heading_deg, pitch_deg, roll_deg;  // PD5 only
};

// The same as a PD0 ensemble: the bottom's velocity, and the date at which its time of day is nearest to
// `near_utc_ns`. Beam velocities stay without meaning: these formats do not hold the beam angle.
[[nodiscard]] Pd0Ensemble toPd0(const Pd45Ensemble& ensemble, std::int64_t near_utc_ns);

// Finds and reads PD4 and PD5 ensembles in a stream of bytes (EnsembleStream). Memory is taken at
// construction.
class Pd45Decoder {
 public:
  static constexpr std::size_t kPd4Bytes = 47, kPd5Bytes = 88;

  Pd45Decoder();

  // As those of EnsembleStream.
  [[nodiscard]] std::size_t accept(std::span<const std::uint8_t> bytes) noexcept {
    return stream_.accept(bytes);
  }
  [[nodiscard]] std::size_t pendingBytes() const noexcept { return stream_.pendingBytes(); }
  [[nodiscard]] const EnsembleStream::Counts& counts() const noexcept { return stream_.counts(); }
  // The next ensemble, valid until the next call; nullptr when more bytes are needed.
  [[nodiscard]] const Pd45Ensemble* next() noexcept;
  // Of the ensemble that next() gave last; valid until the next accept().
  [[nodiscard]] std::span<const std::uint8_t> rawEnsemble() const noexcept { return raw_; }

 private:
  EnsembleStream stream_;
  Pd45Ensemble ensemble_;
  std::span<const std::uint8_t> raw_;
};

}  // namespace fathom::io
