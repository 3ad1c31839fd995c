#include "firmware_if/mission/mission.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "firmware_if/mission/log/raw_auv.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/civil_time.hpp"
#include "realtime/base/config_keys.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr double kMaxLever = 100.0;                    // [m], of a sensor on the vehicle
constexpr double kMaxEuler = 6.3;                      // [rad], a turn in either direction
constexpr double kMaxTimeOffset = 86400.0;             // [s], a day: a clock set to another zone
constexpr double kMinRate = 0.001, kMaxRate = 1000.0;  // [Hz], of image pairs
constexpr std::size_t kMaxMissionFileBytes = std::size_t{1} << 22;
constexpr double kMaxWaypoint = 1e6;           // [m] from the origin
constexpr double kNominalSoundSpeed = 1500.0;  // [m/s], states nothing
constexpr double kMinSoundSpeed = 1350.0;      // [m/s], cold fresh water
constexpr double kMaxSoundSpeed = 1650.0;      // [m/s], hot brine
constexpr std::array<int, 4> kPixelBits = {8, 10, 12, 16};
constexpr std::array<const char*, 3> kPixelFormats = {"mono", "bayer-rggb",
                                                      "rgb"};  // in the order of PixelFormat

PixelFormat readPixelFormat(const ConfigTable& table, const char* key) {
  static_cast<void>(table.requiredText(key));
  const std::string name = table.choice(key, "", {kPixelFormats.begin(), kPixelFormats.end()});
  const auto found = std::find(kPixelFormats.begin(), kPixelFormats.end(), name);
  return static_cast<PixelFormat>(found - kPixelFormats.begin());
}

SE3 readSensorPose(const ConfigTable& table, const char* key) {
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
  c.origin.latitude = top.requiredNumber("origin_latitude", -kMaxOriginLatitude_deg, kMaxOriginLatitude_deg) *
                      kRadiansPerDegree;
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
  c.cameras.left_format = readPixelFormat(cameras, "left_format");
  c.cameras.right_format = readPixelFormat(cameras, "right_format");
  c.cameras.bits = static_cast<int>(cameras.requiredInteger("bits", kPixelBits.front(), kPixelBits.back()));
  if (std::find(kPixelBits.begin(), kPixelBits.end(), c.cameras.bits) == kPixelBits.end())
    cameras.fail("bits", std::to_string(c.cameras.bits) + " is unknown; give 8, 10, 12 or 16");
  c.cameras.rate_hz = cameras.requiredNumber("rate_hz", kMinRate, kMaxRate);

  c.dvl.phased_array = top.table("dvl").boolean("phased_array", c.dvl.phased_array);

  const ConfigTable extrinsics = top.table("extrinsics");
  for (const auto& [name, pose] : MissionConfig::posesOf(c)) *pose = readSensorPose(extrinsics, name);

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

// Degrees that times kRadiansPerDegree give these radians to the bit, where there are any (sometimes doubles
// of degrees are the coarser grid); else the nearest, within one unit in the last place.
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

// Euler angles rounded to a picoradian: far below any calibration, and far above the rounding of a
// quaternion, so that angles read from a file are written as they stood there.
Eigen::Vector3d writtenEuler(const SE3& pose) {
  constexpr double kResolution = 1e-12;  // [rad]
  Eigen::Vector3d euler = pose.euler();
  for (double& angle : euler) angle = std::round(angle / kResolution) / (1.0 / kResolution) + 0.0;
  return euler;
}

std::string missionText(const MissionConfig& c) {
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
      << "\nleft_format = " << tomlString(kPixelFormats.at(static_cast<std::size_t>(c.cameras.left_format)))
      << "\nright_format = " << tomlString(kPixelFormats.at(static_cast<std::size_t>(c.cameras.right_format)))
      << "\nbits = " << c.cameras.bits << "\nrate_hz = " << tomlNumber(c.cameras.rate_hz) << "\n";
  if (c.dvl.phased_array) out << "\n[dvl]\nphased_array = true\n";
  for (const auto& [name, pose] : MissionConfig::posesOf(c))
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

// InputError for a path that can be no folder, std::system_error when the disk refuses.
void makeFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error) return;
  for (const std::errc never : {std::errc::not_a_directory, std::errc::file_exists,
                                std::errc::filename_too_long, std::errc::too_many_symbolic_link_levels})
    if (error == never)
      throw InputError(folder, "", "cannot be made (" + error.message() + "); give another folder");
  throw std::system_error(error, folder.string() + ": cannot be made");
}

// Reads a file to its end, so that a disk that refuses is not reported as a wrong file.
void requireReadable(const std::filesystem::path& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  char piece[4096];
  ssize_t n = file.open() ? 1 : -1;
  while (n > 0) n = ::read(file.get(), piece, sizeof piece);
  const int error = errno;
  const bool good = n == 0 || (file.open() && error == EISDIR);
  if (!good) throw std::system_error(error, std::generic_category(), path.string() + ": cannot be read");
}

// An unfinished mission.toml, as left by a run that the disk refused, does not count.
bool holdsAnything(const std::filesystem::path& folder) {
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().filename() != "mission.toml.tmp") return true;
  return false;
}

}  // namespace

MissionConfig readMissionConfig(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "mission.toml";
  const std::vector<std::uint8_t> bytes =
      readFileBytes(path, kMaxMissionFileBytes, "the mission.toml of a mission folder");
  return configFrom(
      ConfigTable::parse({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, path.string()));
}

void writeMissionConfig(const std::filesystem::path& folder, const MissionConfig& config) {
  const std::filesystem::path path = folder / "mission.toml";
  const std::string text = missionText(config);
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

MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig) {
  const MissionPaths paths(folder);
  makeFolder(folder);
  const bool holds_mission = std::filesystem::exists(folder / "mission.toml");
  // Nothing is ever removed from, or mixed into, a folder that is no mission's.
  if (!holds_mission && holdsAnything(folder))
    throw InputError(folder, "", "is not empty and holds no mission.toml; give an empty folder or a mission");
  MissionConfig found = mission;
  if (holds_mission) {
    requireReadable(folder / "mission.toml");
    found = readMissionConfig(folder);
    if (found.vehicle_id != mission.vehicle_id || found.dive_id != mission.dive_id)
      throw InputError(folder, "mission.toml",
                       "is of vehicle " + std::to_string(found.vehicle_id) + ", dive " +
                           std::to_string(found.dive_id) + "; give each dive its own folder");
  } else {
    writeMissionConfig(folder, mission);
  }
  if (!std::filesystem::exists(paths.calib())) writeStereoCalib(paths.calib(), rig);
  makeFolder(paths.images());
  return found;
}

bool deriveRawAuv(const std::filesystem::path& folder, const std::function<bool()>& go_on) {
  const MissionConfig mission = readMissionConfig(folder);
  const CivilTime start = civilFromUtc(mission.start_utc_ns);
  char time[80];
  std::snprintf(time, sizeof time, "%04d%02d%02d_%02d%02d%02d", start.year, start.month, start.day,
                start.hour, start.minute, start.second);
  SensorLogReader log(folder);
  RawAuvWriter text(folder / (mission.vehicle_name + "_" + time + ".RAW.auv"), mission.origin,
                    mission.magnetic_declination);
  constexpr int kSamplesBetweenLooks = 256;
  int count = 0;
  while (const auto entry = log.next()) {
    text.write(entry->sample);
    if (++count % kSamplesBetweenLooks == 0 && go_on && !go_on()) return false;
  }
  text.commit();
  return true;
}

}  // namespace fathom::io
