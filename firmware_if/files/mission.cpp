#include "firmware_if/files/mission.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include "firmware_if/files/civil_time.hpp"
#include "firmware_if/files/file_bytes.hpp"
#include "firmware_if/files/toml_text.hpp"
#include "realtime/kernel/config_table.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"

namespace fathom::io {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;
constexpr double kMaxLatitude = 89.9;       // [deg]; the local projection has no north at the poles
constexpr double kMaxLever = 100.0;         // [m], of a sensor on the vehicle
constexpr double kMaxEuler = 6.3;           // [rad], a turn either way
constexpr double kMaxTimeOffset = 86400.0;  // [s], a day: a clock set to another zone
constexpr double kMinRate = 0.001, kMaxRate = 1000.0;  // [Hz], of image pairs
constexpr std::size_t kMaxFileBytes = std::size_t{1} << 22;
constexpr double kMaxWaypoint = 1e6;           // [m] from the origin
constexpr double kNominalSoundSpeed = 1500.0;  // [m/s], states nothing
constexpr double kMinSoundSpeed = 1350.0;      // [m/s], cold fresh water
constexpr double kMaxSoundSpeed = 1650.0;      // [m/s], hot brine
constexpr std::array<int, 4> kBits = {8, 10, 12, 16};
constexpr std::array<const char*, 3> kFormats = {"mono", "bayer-rggb", "rgb"};  // in the order of PixelFormat

PixelFormat readFormat(const ConfigTable& table, const char* key) {
  static_cast<void>(table.requiredText(key));
  const std::string name = table.choice(key, "", {kFormats.begin(), kFormats.end()});
  const auto found = std::find(kFormats.begin(), kFormats.end(), name);
  return static_cast<PixelFormat>(found - kFormats.begin());
}

SE3 readPose(const ConfigTable& table, const char* key) {
  const ConfigTable pose = table.table(key);
  const std::vector<double> t = pose.requiredNumbers("translation_m", 3, -kMaxLever, kMaxLever);
  const std::vector<double> euler = pose.requiredNumbers("euler_rad", 3, -kMaxEuler, kMaxEuler);
  return SE3::fromEuler(euler[0], euler[1], euler[2], {t[0], t[1], t[2]});
}

bool usableVehicleName(const std::string& name) {
  constexpr std::size_t kMaxBytes = 32;
  return !name.empty() && name.size() <= kMaxBytes &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) {
           return c < 0x80 && (std::isalnum(c) != 0 || c == '-' || c == '_');
         });
}

MissionConfig configFrom(const ConfigTable& top) {
  MissionConfig c;
  c.vehicle_name = top.requiredText("vehicle_name");
  if (!usableVehicleName(c.vehicle_name))
    top.fail("vehicle_name", "must be 1 to 32 letters, digits, '-' or '_': it names files and LCM channels");
  c.vehicle_id = static_cast<std::uint8_t>(top.requiredInteger("vehicle_id", 0, 255));
  c.dive_id = static_cast<std::uint16_t>(top.requiredInteger("dive_id", 0, 65535));
  c.software_version = top.text("software_version", "");
  c.configuration = top.text("configuration", "");
  c.origin.latitude = top.requiredNumber("origin_latitude", -kMaxLatitude, kMaxLatitude) * kRadiansPerDegree;
  c.origin.longitude = top.requiredNumber("origin_longitude", -180, 180) * kRadiansPerDegree;
  c.start_utc_ns = top.requiredUtc("start_time");
  c.magnetic_declination = top.requiredNumber("magnetic_declination_deg", -180, 180) * kRadiansPerDegree;
  c.tide_model = top.text("tide_model", c.tide_model);

  const ConfigTable water = top.table("water");
  const double sound_speed =
      water.number("sound_speed_mps", kNominalSoundSpeed, kMinSoundSpeed, kMaxSoundSpeed);
  if (sound_speed != kNominalSoundSpeed) c.water.sound_speed = sound_speed;
  c.water.refractive_port = water.text("refractive_port", c.water.refractive_port);

  const ConfigTable cameras = top.table("cameras");
  c.cameras.left_serial = cameras.text("left_serial", "");
  c.cameras.right_serial = cameras.text("right_serial", "");
  c.cameras.left_format = readFormat(cameras, "left_format");
  c.cameras.right_format = readFormat(cameras, "right_format");
  c.cameras.bits = static_cast<int>(cameras.requiredInteger("bits", kBits.front(), kBits.back()));
  if (std::find(kBits.begin(), kBits.end(), c.cameras.bits) == kBits.end())
    cameras.fail("bits", std::to_string(c.cameras.bits) + " is unknown; give 8, 10, 12 or 16");
  c.cameras.rate_hz = cameras.requiredNumber("rate_hz", kMinRate, kMaxRate);

  c.dvl.phased_array = top.table("dvl").boolean("phased_array", c.dvl.phased_array);

  const ConfigTable extrinsics = top.table("extrinsics");
  c.T_body_cam = readPose(extrinsics, "T_body_cam");
  c.T_body_dvl = readPose(extrinsics, "T_body_dvl");
  c.T_body_usbl = readPose(extrinsics, "T_body_usbl");
  c.T_body_depth = readPose(extrinsics, "T_body_depth");
  c.T_body_compass = readPose(extrinsics, "T_body_compass");

  const ConfigTable offsets = top.table("time_offsets");
  const auto offset = [&](const char* key) {
    return offsets.number(key, 0, -kMaxTimeOffset, kMaxTimeOffset);
  };
  c.time_offsets = {offset("left_camera_s"), offset("right_camera_s"), offset("dvl_s"), offset("compass_s"),
                    offset("depth_s")};

  for (const ConfigTable& waypoint : top.tables("plan"))
    c.plan.push_back({waypoint.requiredNumber("north_m", -kMaxWaypoint, kMaxWaypoint),
                      waypoint.requiredNumber("east_m", -kMaxWaypoint, kMaxWaypoint)});
  top.finish();
  return c;
}

// Degrees whose product with kRadiansPerDegree gives these radians back to the bit, where such degrees exist
// (a double of degrees is sometimes the coarser grid; then the nearest, within one unit in the last place).
double exactDegrees(double radians) {
  const double nearest = radians / kRadiansPerDegree;
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double degrees :
       {nearest, std::nextafter(nearest, infinity), std::nextafter(nearest, -infinity)})
    if (degrees * kRadiansPerDegree == radians) return degrees;
  return nearest;
}

std::string vectorText(const Eigen::Vector3d& v) {
  return "[" + tomlNumber(v.x()) + ", " + tomlNumber(v.y()) + ", " + tomlNumber(v.z()) + "]";
}

// Euler angles to a picoradian: far below any calibration, far above the noise of the way through a
// quaternion, so that what was read from a file is written as it stood there.
Eigen::Vector3d writtenEuler(const SE3& pose) {
  constexpr double kResolution = 1e-12;  // [rad]
  Eigen::Vector3d euler = pose.euler();
  for (double& angle : euler) angle = std::round(angle / kResolution) / (1.0 / kResolution) + 0.0;
  return euler;
}

std::string render(const MissionConfig& c) {
  std::ostringstream out;
  out << "# A Fathom mission. Names carry the units; origin_latitude and origin_longitude are degrees "
         "(WGS84).\n"
      << "vehicle_name = " << tomlString(c.vehicle_name) << "\nvehicle_id = " << int{c.vehicle_id}
      << "\ndive_id = " << c.dive_id << "\nsoftware_version = " << tomlString(c.software_version)
      << "\norigin_latitude = " << tomlNumber(exactDegrees(c.origin.latitude))
      << "\norigin_longitude = " << tomlNumber(exactDegrees(c.origin.longitude))
      << "\nstart_time = " << isoTime(c.start_utc_ns)
      << "\nmagnetic_declination_deg = " << tomlNumber(exactDegrees(c.magnetic_declination))
      << "\ntide_model = " << tomlString(c.tide_model) << "\nconfiguration = " << tomlString(c.configuration)
      << "\n\n[water]\nsound_speed_mps = " << tomlNumber(c.water.sound_speed.value_or(kNominalSoundSpeed))
      << "\nrefractive_port = " << tomlString(c.water.refractive_port)
      << "\n\n[cameras]\nleft_serial = " << tomlString(c.cameras.left_serial)
      << "\nright_serial = " << tomlString(c.cameras.right_serial)
      << "\nleft_format = " << tomlString(kFormats.at(static_cast<std::size_t>(c.cameras.left_format)))
      << "\nright_format = " << tomlString(kFormats.at(static_cast<std::size_t>(c.cameras.right_format)))
      << "\nbits = " << c.cameras.bits << "\nrate_hz = " << tomlNumber(c.cameras.rate_hz) << "\n";
  if (c.dvl.phased_array) out << "\n[dvl]\nphased_array = true\n";
  const std::array<std::pair<const char*, const SE3*>, 5> poses = {{{"T_body_cam", &c.T_body_cam},
                                                                    {"T_body_dvl", &c.T_body_dvl},
                                                                    {"T_body_usbl", &c.T_body_usbl},
                                                                    {"T_body_depth", &c.T_body_depth},
                                                                    {"T_body_compass", &c.T_body_compass}}};
  for (const auto& [name, pose] : poses)
    out << "\n[extrinsics." << name << "]\ntranslation_m = " << vectorText(pose->translation())
        << "\neuler_rad = " << vectorText(writtenEuler(*pose)) << "\n";
  out << "\n[time_offsets]\nleft_camera_s = " << tomlNumber(c.time_offsets.left_camera)
      << "\nright_camera_s = " << tomlNumber(c.time_offsets.right_camera)
      << "\ndvl_s = " << tomlNumber(c.time_offsets.dvl)
      << "\ncompass_s = " << tomlNumber(c.time_offsets.compass)
      << "\ndepth_s = " << tomlNumber(c.time_offsets.depth) << "\n";
  for (const MissionConfig::Waypoint& waypoint : c.plan)
    out << "\n[[plan]]\nnorth_m = " << tomlNumber(waypoint.north)
        << "\neast_m = " << tomlNumber(waypoint.east) << "\n";
  return out.str();
}

}  // namespace

MissionConfig readMissionConfig(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "mission.toml";
  const std::vector<std::uint8_t> bytes =
      readFileBytes(path, kMaxFileBytes, "the mission.toml of a mission folder");
  return configFrom(
      ConfigTable::parse({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, path.string()));
}

void writeMissionConfig(const std::filesystem::path& folder, const MissionConfig& config) {
  const std::filesystem::path path = folder / "mission.toml";
  const std::string text = render(config);
  // Read back before anything is written: a mission that no program would open is refused here.
  static_cast<void>(configFrom(ConfigTable::parse(text, path.string())));
  writeFile(path, text);
}

std::optional<std::filesystem::path> MissionPaths::rawAuv() const {
  static const std::string kEnding = ".RAW.auv";
  std::vector<std::filesystem::path> found;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(root, error)) {
    const std::string name = entry.path().filename().string();
    if (name.size() > kEnding.size() && name.ends_with(kEnding) && entry.is_regular_file(error))
      found.push_back(entry.path());
  }
  if (found.size() > 1) {
    std::sort(found.begin(), found.end());
    throw InputError(root, "*" + kEnding,
                     std::to_string(found.size()) + " such files (" + found[0].filename().string() + ", " +
                         found[1].filename().string() + "...); leave one");
  }
  if (found.empty()) return std::nullopt;
  return found.front();
}

}  // namespace fathom::io
