#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "telemetry/wire/downlink_messages.hpp"

namespace fathom::telemetry {

// What became of a request that the vehicle has heard.
struct RequestOutcome {
  enum class State : std::uint8_t { kNone, kTaken, kDone, kRefused };
  State state = State::kNone;   // kNone: no request
  std::uint8_t id = 0;          // as in Request
  DownlinkCounter counter = 0;  // of the frame that brought it; only the kOutcomeCounterBits lowest travel
  friend bool operator==(const RequestOutcome&, const RequestOutcome&) = default;
};
inline constexpr unsigned kOutcomeCounterBits = 10;

// How the vehicle stands to the ship's requests, and its health: small, sent at once when something of it
// changes and again until the ship has it.
struct Report {
  std::uint16_t health = 0;  // HealthFlag, as in Status
  bool paused = false;       // sends no map, as it was asked to
  double rate_bps = 0;       // that it sends at [bit/s], to 10 bit/s
  // The last ones heard, newest first; those that are taken and not done are not forgotten.
  std::array<RequestOutcome, 6> requests{};
  friend bool operator==(const Report&, const Report&) = default;
};
inline constexpr std::size_t kReportBytes = 16;

// Returns the payload's size, 0 if `out` is too small.
[[nodiscard]] std::size_t encodeReport(const Report& report, std::span<std::uint8_t> out);
// False (report untouched) if the payload is not valid.
[[nodiscard]] bool decodeReport(std::span<const std::uint8_t> payload, Report& report);

}  // namespace fathom::telemetry
