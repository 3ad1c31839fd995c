#include "realtime/base/civil_time.hpp"

#include <chrono>
#include <cstdio>

namespace fathom::io {
namespace {

using Nanoseconds = std::chrono::sys_time<std::chrono::nanoseconds>;

// Whole years inside the range of int64 nanoseconds.
constexpr int kFirstYear = 1678, kLastYear = 2261;

}  // namespace

CivilTime civilFromUtc(std::int64_t utc_ns) {
  const Nanoseconds time{std::chrono::nanoseconds(utc_ns)};
  const auto midnight = std::chrono::floor<std::chrono::days>(time);
  const std::chrono::year_month_day date(midnight);
  const std::chrono::hh_mm_ss clock(time - midnight);
  CivilTime civil;
  civil.year = static_cast<int>(date.year());
  civil.month = static_cast<int>(static_cast<unsigned>(date.month()));
  civil.day = static_cast<int>(static_cast<unsigned>(date.day()));
  civil.hour = static_cast<int>(clock.hours().count());
  civil.minute = static_cast<int>(clock.minutes().count());
  civil.second = static_cast<int>(clock.seconds().count());
  civil.nanosecond = static_cast<int>(clock.subseconds().count());
  return civil;
}

std::optional<std::int64_t> utcFromCivil(const CivilTime& civil) {
  if (civil.year < kFirstYear || civil.year > kLastYear) return std::nullopt;
  if (civil.month < 1 || civil.month > 12 || civil.day < 1 || civil.day > 31) return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year(civil.year),
                                         std::chrono::month(static_cast<unsigned>(civil.month)),
                                         std::chrono::day(static_cast<unsigned>(civil.day))};
  if (!date.ok() || civil.hour < 0 || civil.hour > 23 || civil.minute < 0 || civil.minute > 59 ||
      civil.second < 0 || civil.second > 59 || civil.nanosecond < 0 || civil.nanosecond > 999'999'999)
    return std::nullopt;
  const Nanoseconds time = std::chrono::sys_days(date) + std::chrono::hours(civil.hour) +
                           std::chrono::minutes(civil.minute) + std::chrono::seconds(civil.second) +
                           std::chrono::nanoseconds(civil.nanosecond);
  return time.time_since_epoch().count();
}

std::string isoTime(std::int64_t utc_ns) {
  const CivilTime t = civilFromUtc(utc_ns);
  char text[96];
  std::snprintf(text, sizeof text, "%04d-%02d-%02dT%02d:%02d:%02d.%09dZ", t.year, t.month, t.day, t.hour,
                t.minute, t.second, t.nanosecond);
  return text;
}

}  // namespace fathom::io
