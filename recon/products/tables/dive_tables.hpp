#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/camera.hpp"
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

// Corners of an image on a level plane `range` below the camera [m], clockwise from the top left one: north,
// east, depth. Empty where a corner's ray does not reach it within four times that distance.
[[nodiscard]] std::vector<Eigen::Vector3d> footprintOnPlane(const Camera& camera, const SE3& T_nav_cam,
                                                            double range);

// track.json and images.json, as the viewer's page reads them (README.md of this folder).
// `timed` false: times count from the first image.
void writeTrackJson(const std::filesystem::path& path, const std::vector<DiveTrackPoint>& track, bool timed);
void writeImagesJson(const std::filesystem::path& path, const std::vector<ImageRow>& images,
                     const Camera& camera);

// Tables of images, one row a left image, for annotation tools, in `folder`:
//   images.csv          everything, both images, names with units
//   images_squidle.csv  Squidle+: key, timestamp_start, pose.lat, pose.lon, pose.dep, pose.alt, pose.data.*
//   images_catami.csv   CATAMI data package 1.0 (images.csv there): no header, -999 for what is unknown
//   images_biigle.csv   BIIGLE image metadata: filename, taken_at, lng, lat, gps_altitude, ...
// Without `origin` nobody knows where the dive was. What is not known stays empty. Returns the names written.
std::vector<std::string> writeImageTables(const std::filesystem::path& folder,
                                          const std::optional<Geodetic>& origin,
                                          const std::vector<ImageRow>& images);

}  // namespace fathom::topside
