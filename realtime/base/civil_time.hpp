#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace fathom::io {

// Date and time of day in UTC, proleptic Gregorian calendar, without leap seconds (as Unix time).
struct CivilTime {
  int year = 1970, month = 1, day = 1;
  int hour = 0, minute = 0, second = 0;
  int nanosecond = 0;
};

[[nodiscard]] CivilTime civilFromUtc(std::int64_t utc_ns);
// std::nullopt for a date or time of day that does not exist, and outside the years 1678 to 2261, which int64
// nanoseconds hold.
[[nodiscard]] std::optional<std::int64_t> utcFromCivil(const CivilTime& civil);
// As 2024-02-17T05:15:49.768000000Z.
[[nodiscard]] std::string isoTime(std::int64_t utc_ns);

}  // namespace fathom::io
