#include "recon/products/tables/dive_track.hpp"

#include <algorithm>
#include <cmath>

#include "firmware_if/mission/sensor_log.hpp"
#include "recon/geometry/sea_water.hpp"

namespace fathom::topside {
namespace {

constexpr double kPascalPerMetre = 10'080;  // of sea water: a percent of it is nothing to salinity
constexpr double kSurfaceDepth = 1;         // above it the vehicle is at the surface [m]

constexpr std::array<WaterPropertyInfo, kWaterProperties> kInfo = {{
    {"conductivity", "conductivity_s_m", "Conductivity along the track", "S/m"},
    {"temperature", "temperature_c", "Temperature along the track", "deg C"},
    {"salinity", "salinity_psu", "Salinity along the track", "psu"},
    {"sound_speed", "sound_speed_m_s", "Speed of sound along the track", "m/s"},
    {"chlorophyll", "chlorophyll_ug_l", "Chlorophyll along the track", "ug/l"},
    {"cdom", "cdom_ppb", "Coloured dissolved organic matter along the track", "ppb"},
    {"turbidity", "turbidity_1_m_sr", "Optical backscatter along the track", "1/m/sr"},
}};

// What a sample itself holds; salinity follows later.
std::array<std::optional<double>, kWaterProperties> valuesOf(const WaterSample& s) {
  return {s.conductivity, s.temperature, std::nullopt, s.sound_speed, s.chlorophyll, s.cdom, s.turbidity};
}

}  // namespace

const WaterPropertyInfo& infoOf(WaterProperty property) {
  return kInfo[static_cast<std::size_t>(property)];
}

WaterLog::WaterLog(std::vector<WaterSample> samples) : samples_(std::move(samples)) {
  std::stable_sort(samples_.begin(), samples_.end(),
                   [](const WaterSample& a, const WaterSample& b) { return a.utc_ns < b.utc_ns; });
}

Water WaterLog::at(std::int64_t utc_ns, double depth) const {
  Water water;
  if (samples_.empty()) return water;
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), utc_ns,
                                      [](const WaterSample& s, std::int64_t t) { return s.utc_ns < t; });
  const WaterSample& b = after == samples_.end() ? samples_.back() : *after;
  const WaterSample& a = after == samples_.begin() ? samples_.front() : *(after - 1);
  // Beyond either end the nearest sample holds as long as between two.
  if (std::abs(static_cast<double>(utc_ns - a.utc_ns)) > static_cast<double>(kMaxGap) ||
      std::abs(static_cast<double>(b.utc_ns - utc_ns)) > static_cast<double>(kMaxGap))
    return water;
  const double span = static_cast<double>(b.utc_ns - a.utc_ns);
  const double s = span > 0 ? std::clamp(static_cast<double>(utc_ns - a.utc_ns) / span, 0.0, 1.0) : 0.0;
  const auto from = valuesOf(a), to = valuesOf(b);
  for (std::size_t k = 0; k < kWaterProperties; ++k)
    if (from[k] && to[k]) water[k] = *from[k] + s * (*to[k] - *from[k]);
  const auto &conductivity = water[static_cast<std::size_t>(WaterProperty::kConductivity)],
             &temperature = water[static_cast<std::size_t>(WaterProperty::kTemperature)];
  if (conductivity && temperature) {
    const double salinity =
        practicalSalinity(*conductivity, *temperature, std::max(0.0, depth) * kPascalPerMetre);
    if (std::isfinite(salinity)) water[static_cast<std::size_t>(WaterProperty::kSalinity)] = salinity;
  }
  return water;
}

std::vector<WaterSample> readWater(const std::filesystem::path& mission_folder) {
  std::vector<WaterSample> samples;
  io::SensorLogReader reader(mission_folder);
  while (const auto entry = reader.next())
    if (const auto* sample = std::get_if<WaterSample>(&entry->sample)) samples.push_back(*sample);
  return samples;
}

void nameStages(std::vector<DiveTrackPoint>& track, std::int64_t first_image_utc_ns,
                std::int64_t last_image_utc_ns) {
  for (DiveTrackPoint& point : track) {
    if (point.T_nav_body && point.T_nav_body->translation().z() < kSurfaceDepth)
      point.stage = "surface";
    else if (point.utc_ns < first_image_utc_ns)
      point.stage = "descent";
    else
      point.stage = point.utc_ns > last_image_utc_ns ? "ascent" : "survey";
  }
}

}  // namespace fathom::topside
