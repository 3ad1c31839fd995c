#pragma once

#include <cstdint>
#include <optional>

#include "firmware_if/files/mission.hpp"

namespace fathom::topside {

// Height of the sea over nav's zero as mission.toml foretells it, which a pressure sensor takes for depth:
//   h = amplitude sin(2 pi t / period + phase),   t since start_time.
struct Tide {
  double amplitude = 0, period = 0, phase = 0;  // [m], [s], [rad]
  std::int64_t start_utc_ns = 0;
  [[nodiscard]] double heightAt(std::int64_t utc_ns) const;  // [m]
};

// From the mission's tide_model: "none", or "sinusoid amplitude_m=A period_s=P phase_rad=F". std::nullopt for
// none. Throws InputError for any other text.
[[nodiscard]] std::optional<Tide> readTide(const io::MissionPaths& paths, const io::MissionConfig& mission);

}  // namespace fathom::topside
