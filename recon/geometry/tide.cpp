#include "recon/geometry/tide.hpp"

#include <cmath>
#include <cstdio>
#include <numbers>

#include "realtime/kernel/input_error.hpp"

namespace fathom {

double Tide::heightAt(std::int64_t utc_ns) const noexcept {
  const double t = static_cast<double>(utc_ns - start_utc_ns) * 1e-9;
  return amplitude * std::sin(2 * std::numbers::pi * t / period + phase);
}

std::optional<Tide> readTide(const std::string& tide_model, std::int64_t start_utc_ns) {
  if (tide_model == "none" || tide_model.empty()) return std::nullopt;
  Tide tide;
  tide.start_utc_ns = start_utc_ns;
  int end = 0;
  const int read = std::sscanf(tide_model.c_str(), "sinusoid amplitude_m=%lf period_s=%lf phase_rad=%lf%n",
                               &tide.amplitude, &tide.period, &tide.phase, &end);
  const bool whole = read == 3 && static_cast<std::size_t>(end) == tide_model.size();
  if (!whole || !(tide.period > 0) || !std::isfinite(tide.amplitude) || !std::isfinite(tide.phase))
    throw InputError("mission.toml", "tide_model",
                     "'" + tide_model +
                         "' is no model that is known; give none, or sinusoid amplitude_m=A period_s=P "
                         "phase_rad=F, the height of the sea over nav's zero from start_time on");
  return tide;
}

}  // namespace fathom
