#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// The text output PD6: lines that begin with a colon and a two-letter name, fields between commas, CR LF at
// the end. Source: "Pathfinder DVL Guide" (TRDI P/N 957-6172), table "Output Data Format (PD6)"; the same in
// the guides of Workhorse Navigator and Explorer. Of an ensemble's lines these are read:
//
//   :SA,pitch,roll,heading [deg]                        begins an ensemble
//   :TS,YYMMDDHHmmsshh,salinity,temperature,depth,sound speed [m/s],built-in test
//   :BI,x,y,z,error,status    bottom track, instrument: + starboard (beam 1 to 2), + forward (4 to 3), + up
//   :BS,transverse,longitudinal,normal,status           the same in the ship's frame, all [mm/s]
//   :BD,east,north,up,range,time since good             range to the bottom [m]; ends an ensemble
//
// Velocities are the instrument's over a bottom at rest; status A is good, V is bad. There is no checksum: a
// line with a wrong number of fields, or a field that is no number of its range, is refused, and its ensemble
// loses that value.
struct Pd6Ensemble {
  std::optional<std::int64_t> utc_ns;  // the instrument's clock, taken as UTC
  DvlSample sample;                    // utc_ns 0 where the ensemble has no time
};

class Pd6Decoder {
 public:
  struct Counts {
    std::uint64_t good = 0;           // ensembles with a time or a bottom-track line
    std::uint64_t bad_lines = 0;      // of the lines above: fields that make no sense
    std::uint64_t skipped_bytes = 0;  // that belong to no line that begins with a colon
  };

  // Takes one byte; true when an ensemble has ended with it, which is then in ensemble() and rawEnsemble()
  // until the next call.
  [[nodiscard]] bool push(std::uint8_t byte) noexcept;
  [[nodiscard]] const Pd6Ensemble& ensemble() const noexcept { return finished_; }
  [[nodiscard]] std::span<const std::uint8_t> rawEnsemble() const noexcept {
    return {raw_.data(), raw_finished_};
  }
  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }
  // Forgets the ensemble that has begun.
  void restart() noexcept;

 private:
  // False for one of the lines above that makes no sense.
  bool readLine(std::span<const char> line) noexcept;

  std::array<char, 128> line_{};  // the longest line has some 70 characters
  std::size_t line_size_ = 0;
  bool in_line_ = false;
  std::array<std::uint8_t, 1024> raw_{};  // of the ensemble being received
  std::size_t raw_size_ = 0, raw_finished_ = 0;
  Pd6Ensemble open_, finished_;
  bool instrument_line_ = false;  // :BI came, so :BS is not used
  bool velocity_good_ = false, any_ = false;
  Counts counts_;
};

}  // namespace fathom::io
