#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace fathom {

// Predicted height of the sea over nav's zero, which a pressure sensor takes for depth:
//   h = amplitude sin(2 pi t / period + phase),   t since start_utc_ns.
struct Tide {
  double amplitude = 0, period = 1, phase = 0;  // [m], [s], [rad]
  std::int64_t start_utc_ns = 0;
  [[nodiscard]] double heightAt(std::int64_t utc_ns) const noexcept;  // [m]
};

// From tide_model of mission.toml: "none", or "sinusoid amplitude_m=A period_s=P phase_rad=F" from the
// mission's start on. std::nullopt for none. Throws InputError for any other text.
[[nodiscard]] std::optional<Tide> readTide(const std::string& tide_model, std::int64_t start_utc_ns);

}  // namespace fathom
