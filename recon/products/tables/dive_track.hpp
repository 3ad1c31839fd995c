#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::topside {

// Water properties that a vehicle may record, in this order everywhere.
enum class WaterProperty : std::uint8_t {
  kConductivity,
  kTemperature,
  kSalinity,
  kSoundSpeed,
  kChlorophyll,
  kCdom,
  kTurbidity
};
constexpr std::size_t kWaterProperties = 7;
struct WaterPropertyInfo {
  const char* name;  // of the layer and the JSON key's beginning
  const char* key;   // with the unit: "temperature_c"
  const char* title;
  const char* unit;
};
[[nodiscard]] const WaterPropertyInfo& infoOf(WaterProperty property);

using Water = std::array<std::optional<double>, kWaterProperties>;

// The water along a dive, for any time: linear between samples no more than `kMaxGap` apart. Salinity comes
// from conductivity, temperature and depth (PSS-78).
class WaterLog {
 public:
  explicit WaterLog(std::vector<WaterSample> samples);
  [[nodiscard]] Water at(std::int64_t utc_ns, double depth) const;
  [[nodiscard]] bool empty() const { return samples_.empty(); }

  static constexpr std::int64_t kMaxGap = 30'000'000'000;  // [ns]

 private:
  std::vector<WaterSample> samples_;  // by time
};
// Every water sample of a mission's log; none where it has no CTD. Throws InputError as SensorLogReader does.
[[nodiscard]] std::vector<WaterSample> readWater(const std::filesystem::path& mission_folder);

// One moment of the dive.
struct DiveTrackPoint {
  std::int64_t utc_ns = 0;
  std::optional<SE3> T_nav_body;
  std::optional<double> altitude;  // [m]
  std::string stage;               // as nameStages() says, or empty
  Water water;
};

// Names what the vehicle does at each point: "surface" (above 1 m), "descent" before the first image,
// "survey" between first and last, "ascent" after it.
void nameStages(std::vector<DiveTrackPoint>& track, std::int64_t first_image_utc_ns,
                std::int64_t last_image_utc_ns);

// One stereo pair.
struct ImageRow {
  std::string left, right;             // file names
  std::optional<std::int64_t> utc_ns;  // none: nobody knows
  SE3 T_nav_body, T_nav_cam;
  std::optional<double> altitude;  // of the vehicle above the ground, vertical [m]
  // Corners of the left image on the ground, from the top left one clockwise: north, east, depth [m]. Empty
  // where they are not known.
  std::vector<Eigen::Vector3d> footprint;
  Water water;
};

}  // namespace fathom::topside
