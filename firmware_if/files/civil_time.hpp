#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace fathom::io {

// A moment in the proleptic Gregorian calendar, UTC. Leap seconds do not exist here, as in Unix time.
struct CivilTime {
  int year = 1970, month = 1, day = 1;
  int hour = 0, minute = 0, second = 0;
  int nanosecond = 0;
};

[[nodiscard]] CivilTime civilFromUtc(std::int64_t utc_ns);
// std::nullopt for a date or time of day that does not exist, or one that int64 nanoseconds cannot hold
// (years before 1678 or after 2261).
[[nodiscard]] std::optional<std::int64_t> utcFromCivil(const CivilTime& civil);
// As 2024-02-17T05:15:49.768000000Z.
[[nodiscard]] std::string isoTime(std::int64_t utc_ns);

}  // namespace fathom::io
