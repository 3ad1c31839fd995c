#include "recon/products/tables/dive_tables.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/civil_time.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
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

namespace {

using Json = nlohmann::ordered_json;

// Numbers in JSON carry no more digits than they are worth: whole numbers of `steps` to the unit.
Json number(double value, double steps = 1e4) {
  return std::isfinite(value) ? Json(std::round(value * steps) / steps) : Json();
}
Json number(const std::optional<double>& value, double steps = 1e4) {
  return value ? number(*value, steps) : Json();
}

double degrees360(double radians) {
  const double degrees = std::fmod(radians * kDegreesPerRadian, 360);
  return degrees < 0 ? degrees + 360 : degrees;
}

std::string fixed(double value, int digits) {
  return std::isfinite(value) ? decimals(value, digits) : std::string();
}
std::string fixed(const std::optional<double>& value, int digits) {
  return value ? fixed(*value, digits) : std::string();
}

std::string timeText(const std::optional<std::int64_t>& utc_ns, char between, const char* zone) {
  if (!utc_ns) return {};
  const io::CivilTime t = io::civilFromUtc(*utc_ns);
  return formatted("%04d-%02d-%02d%c%02d:%02d:%02d.%06d%s", t.year, t.month, t.day, between, t.hour, t.minute,
                   t.second, t.nanosecond / 1000, zone);
}

double areaOf(const std::vector<Eigen::Vector3d>& corners) {
  double twice = 0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const auto &a = corners[k], &b = corners[(k + 1) % corners.size()];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return std::abs(twice) / 2;
}

// What the tables share of an image.
struct Row {
  const ImageRow& image;
  std::optional<double> latitude_deg, longitude_deg;  // of the camera
  double depth;                                       // of the camera [m]
  Eigen::Vector3d euler;                              // of the vehicle: roll, pitch, heading [rad]

  Row(const ImageRow& row, const std::optional<LocalTransverseMercator>& map)
      : image(row), depth(row.T_nav_cam.translation().z()), euler(row.T_nav_body.euler()) {
    if (!map) return;
    const Geodetic place = map->toGeodetic(row.T_nav_cam.translation().head<2>());
    latitude_deg = place.latitude * kDegreesPerRadian;
    longitude_deg = place.longitude * kDegreesPerRadian;
  }
  [[nodiscard]] std::string latitude() const { return fixed(latitude_deg, 9); }
  [[nodiscard]] std::string longitude() const { return fixed(longitude_deg, 9); }
  [[nodiscard]] std::optional<double> water(WaterProperty property) const {
    return image.water[static_cast<std::size_t>(property)];
  }
};

std::string fullHead() {
  std::string head =
      "left_image,right_image,utc,utc_ns,latitude_deg,longitude_deg,depth_m,altitude_m,north_m,east_m,roll_"
      "deg,"
      "pitch_deg,heading_deg,footprint_m2";
  for (std::size_t k = 0; k < kWaterProperties; ++k)
    head += std::string(",") + infoOf(static_cast<WaterProperty>(k)).key;
  return head;
}
std::string fullLine(const Row& row) {
  const Eigen::Vector3d& t = row.image.T_nav_cam.translation();
  std::string line =
      tableField(row.image.left) + ',' + tableField(row.image.right) + ',' +
      timeText(row.image.utc_ns, 'T', "Z") + ',' +
      (row.image.utc_ns ? std::to_string(*row.image.utc_ns) : "") + ',' + row.latitude() + ',' +
      row.longitude() + ',' + fixed(row.depth, 3) + ',' + fixed(row.image.altitude, 3) + ',' +
      fixed(t.x(), 3) + ',' + fixed(t.y(), 3) + ',' + fixed(row.euler.x() * kDegreesPerRadian, 3) + ',' +
      fixed(row.euler.y() * kDegreesPerRadian, 3) + ',' + fixed(degrees360(row.euler.z()), 3) + ',';
  if (!row.image.footprint.empty()) line += fixed(areaOf(row.image.footprint), 3);
  for (const auto& value : row.image.water) line += ',' + fixed(value, 5);
  return line;
}

// The names Squidle+ maps onto its media and poses; pose.data.* are kept beside them.
constexpr const char* kSquidleHead =
    "key,timestamp_start,pose.timestamp,pose.lat,pose.lon,pose.dep,pose.alt,pose.data.roll,pose.data.pitch,"
    "pose.data.heading,pose.data.conductivity,pose.data.temperature,pose.data.salinity";
std::string squidleLine(const Row& row) {
  const std::string time = timeText(row.image.utc_ns, 'T', "");
  return tableField(std::filesystem::path(row.image.left).stem().string()) + ',' + time + ',' + time + ',' +
         row.latitude() + ',' + row.longitude() + ',' + fixed(row.depth, 3) + ',' +
         fixed(row.image.altitude, 3) + ',' + fixed(row.euler.x() * kDegreesPerRadian, 3) + ',' +
         fixed(row.euler.y() * kDegreesPerRadian, 3) + ',' + fixed(degrees360(row.euler.z()), 3) + ',' +
         fixed(row.water(WaterProperty::kConductivity), 5) + ',' +
         fixed(row.water(WaterProperty::kTemperature), 4) + ',' +
         fixed(row.water(WaterProperty::kSalinity), 4);
}

// Time, latitude, longitude, depth, image, camera, angle, temperature, salinity, pitch, roll, yaw [rad],
// altitude.
std::string catamiLine(const Row& row) {
  const auto filled = [](const std::optional<double>& value, int digits) {
    return value ? fixed(*value, digits) : std::string("-999.0");
  };
  return timeText(row.image.utc_ns, ' ', "+00:00") + ',' + filled(row.latitude_deg, 9) + ',' +
         filled(row.longitude_deg, 9) + ',' + fixed(row.depth, 3) + ',' + tableField(row.image.left) +
         ",Left Colour,Down Angle," + filled(row.water(WaterProperty::kTemperature), 4) + ',' +
         filled(row.water(WaterProperty::kSalinity), 4) + ',' + fixed(row.euler.y(), 6) + ',' +
         fixed(row.euler.x(), 6) + ',' + fixed(row.euler.z(), 6) + ',' + filled(row.image.altitude, 3);
}

constexpr const char* kBiigleHead = "filename,taken_at,lng,lat,gps_altitude,distance_to_ground,area,yaw";
std::string biigleLine(const Row& row) {
  return tableField(row.image.left) + ',' + timeText(row.image.utc_ns, ' ', "") + ',' + row.longitude() +
         ',' + row.latitude() + ',' + fixed(-row.depth, 3) + ',' + fixed(row.image.altitude, 3) + ',' +
         (row.image.footprint.empty() ? std::string() : fixed(areaOf(row.image.footprint), 3)) + ',' +
         fixed(degrees360(row.euler.z()), 2);
}

}  // namespace

std::vector<Eigen::Vector3d> footprintOnPlane(const Camera& camera, const SE3& T_nav_cam, double range) {
  constexpr double kFarthest = 4;  // times the range: rays near the horizon meet the plane anywhere
  if (!(range > 0) || !std::isfinite(range)) return {};
  std::vector<Eigen::Vector3d> corners;
  const double right = camera.width - 0.5, bottom = camera.height - 0.5;
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(-0.5, -0.5), Eigen::Vector2d(right, -0.5),
                                       Eigen::Vector2d(right, bottom), Eigen::Vector2d(-0.5, bottom)}) {
    const Eigen::Vector3d ray = T_nav_cam.rotation() * camera.ray(pixel);
    const double along = range / ray.z();
    if (!(ray.z() > 0) || !(along * ray.norm() < kFarthest * range)) return {};
    corners.emplace_back(T_nav_cam.translation() + along * ray);
  }
  return corners;
}

void writeTrackJson(const std::filesystem::path& path, const std::vector<DiveTrackPoint>& track, bool timed) {
  Json utc = Json::array(), north = utc, east = utc, depth = utc, heading = utc, altitude = utc, stage = utc;
  std::array<Json, kWaterProperties> water;
  std::array<bool, kWaterProperties> recorded{};
  water.fill(Json::array());
  for (const DiveTrackPoint& point : track) {
    utc.push_back(std::to_string(point.utc_ns));
    const bool known = point.T_nav_body.has_value();
    const Eigen::Vector3d t = known ? point.T_nav_body->translation() : Eigen::Vector3d::Zero();
    north.push_back(known ? number(t.x(), 1e3) : Json());
    east.push_back(known ? number(t.y(), 1e3) : Json());
    depth.push_back(known ? number(t.z(), 1e3) : Json());
    heading.push_back(known ? number(degrees360(point.T_nav_body->euler().z()), 1e2) : Json());
    altitude.push_back(number(point.altitude, 1e3));
    stage.push_back(point.stage);
    for (std::size_t k = 0; k < kWaterProperties; ++k) {
      water[k].push_back(number(point.water[k]));
      recorded[k] = recorded[k] || point.water[k].has_value();
    }
  }
  Json json = {{"timed", timed}, {"utc_ns", utc},          {"north", north},       {"east", east},
               {"depth", depth}, {"heading_deg", heading}, {"altitude", altitude}, {"stage", stage}};
  for (std::size_t k = 0; k < kWaterProperties; ++k)
    if (recorded[k]) json[infoOf(static_cast<WaterProperty>(k)).key] = water[k];
  writeFile(path, json.dump());
}

void writeImagesJson(const std::filesystem::path& path, const std::vector<ImageRow>& images,
                     const Camera& camera) {
  Json list = Json::array();
  for (const ImageRow& image : images) {
    const Eigen::Vector3d& t = image.T_nav_cam.translation();
    const Eigen::Quaterniond& q = image.T_nav_cam.rotation();
    Json corners = Json::array();
    for (const Eigen::Vector3d& c : image.footprint)
      corners.push_back({number(c.x(), 1e3), number(c.y(), 1e3), number(c.z(), 1e3)});
    constexpr double kTurn = 1e8;  // of a quaternion: a thousandth of a pixel
    list.push_back(
        {{"left", image.left},
         {"right", image.right},
         {"utc_ns", image.utc_ns ? Json(std::to_string(*image.utc_ns)) : Json()},
         {"north", number(t.x())},
         {"east", number(t.y())},
         {"depth", number(t.z())},
         {"q", {number(q.w(), kTurn), number(q.x(), kTurn), number(q.y(), kTurn), number(q.z(), kTurn)}},
         {"altitude", number(image.altitude, 1e3)},
         {"footprint", corners}});
  }
  const Json lens = {{"width", camera.width}, {"height", camera.height}, {"fx", camera.fx}, {"fy", camera.fy},
                     {"cx", camera.cx},       {"cy", camera.cy},         {"k1", camera.k1}, {"k2", camera.k2},
                     {"p1", camera.p1},       {"p2", camera.p2},         {"k3", camera.k3}};
  // File names come from a disk and need not be UTF-8.
  writeFile(path,
            Json({{"images", list}, {"camera", lens}}).dump(-1, ' ', false, Json::error_handler_t::replace));
}

std::vector<std::string> writeImageTables(const std::filesystem::path& folder,
                                          const std::optional<Geodetic>& origin,
                                          const std::vector<ImageRow>& images) {
  std::optional<LocalTransverseMercator> map;
  if (origin) map.emplace(*origin);
  std::string full = fullHead() + '\n', squidle = std::string(kSquidleHead) + '\n', catami,
              biigle = std::string(kBiigleHead) + '\n';
  for (const ImageRow& image : images) {
    const Row row(image, map);
    full += fullLine(row) + '\n';
    squidle += squidleLine(row) + '\n';
    catami += catamiLine(row) + '\n';
    biigle += biigleLine(row) + '\n';
  }
  std::vector<std::string> names = {"images.csv", "images_squidle.csv", "images_catami.csv",
                                    "images_biigle.csv"};
  writeFile(folder / names[0], full);
  writeFile(folder / names[1], squidle);
  writeFile(folder / names[2], catami);
  writeFile(folder / names[3], biigle);
  return names;
}

}  // namespace fathom::topside
