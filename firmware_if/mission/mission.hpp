#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

inline constexpr double kMaxOriginLatitude_deg = 89.9;  // the local projection has no north at the poles

// What mission.toml says, in SI units and radians.
struct MissionConfig {
  std::string vehicle_name = "sirius";
  std::uint8_t vehicle_id = 1;  // on the acoustic link
  std::uint16_t dive_id = 1;    // on the acoustic link; another dive's frames never enter this map
  std::string software_version;
  std::string configuration;  // text of the configuration used, verbatim
  Geodetic origin;            // of nav
  std::int64_t start_utc_ns = 0;
  double magnetic_declination = 0;  // [rad], east positive: true = magnetic + declination
  std::string tide_model = "none";

  struct Water {
    // Mean true speed of sound at the DVL, used without CTD samples [m/s]; none: not stated. 1500.0 in the
    // file is the default of other writers, and is read as none.
    std::optional<double> sound_speed;
    std::string refractive_port = "calibrated-in-water";
  } water;

  struct Cameras {
    std::string left_serial, right_serial;
    PixelFormat left_format = PixelFormat::kBayerRggb;
    PixelFormat right_format = PixelFormat::kMono;
    int bits = 12;
    double rate_hz = 2.0;
  } cameras;

  struct Dvl {
    // Its beams are steered by phase: horizontal velocities do not depend on the speed of sound.
    bool phased_array = false;
  } dvl;

  // Poses of the sensors in body (forward-starboard-down).
  SE3 T_body_cam, T_body_dvl, T_body_usbl, T_body_depth, T_body_compass;
  // Their names in [extrinsics], and where they are in `c`.
  template <class Config>
  static auto posesOf(Config& c) {
    return std::array{std::pair("T_body_cam", &c.T_body_cam), std::pair("T_body_dvl", &c.T_body_dvl),
                      std::pair("T_body_usbl", &c.T_body_usbl), std::pair("T_body_depth", &c.T_body_depth),
                      std::pair("T_body_compass", &c.T_body_compass)};
  }

  // Added to a sensor's time stamp to get UTC [s].
  struct TimeOffsets {
    double left_camera = 0, right_camera = 0, dvl = 0, compass = 0, depth = 0;
  } time_offsets;

  struct Waypoint {
    double north = 0, east = 0;  // [m]
  };
  std::vector<Waypoint> plan;
};

// Reads / writes <folder>/mission.toml. Throws InputError naming file, key (and line) and fix: an absent
// file, a key unknown or missing, a value of the wrong type or out of range.
[[nodiscard]] MissionConfig readMissionConfig(const std::filesystem::path& folder);
void writeMissionConfig(const std::filesystem::path& folder, const MissionConfig& config);

// Paths inside a mission folder.
struct MissionPaths {
  explicit MissionPaths(std::filesystem::path folder) : root(std::move(folder)) {}
  std::filesystem::path root;
  // Calibration and images of a folder that is no mission folder; empty: the usual places.
  std::filesystem::path calib_elsewhere, images_elsewhere;
  [[nodiscard]] std::filesystem::path calib() const {
    return calib_elsewhere.empty() ? root / "stereo.calib" : calib_elsewhere;
  }
  [[nodiscard]] std::filesystem::path log() const { return root / "sensors.lcmlog"; }
  [[nodiscard]] std::filesystem::path images() const {
    return images_elsewhere.empty() ? root / "img" : images_elsewhere;
  }
  [[nodiscard]] std::filesystem::path features() const { return root / "features"; }  // instead of img/
  [[nodiscard]] std::filesystem::path truth() const { return root / "truth"; }
  [[nodiscard]] std::filesystem::path onboard() const { return root / "onboard"; }
  [[nodiscard]] std::filesystem::path monitor() const { return root / "monitor"; }
  [[nodiscard]] std::filesystem::path topside() const { return root / "topside"; }
  // The single *.RAW.auv in the folder, if any.
  [[nodiscard]] std::optional<std::filesystem::path> rawAuv() const;
};

// Makes a folder to record into: mission.toml, stereo.calib and img/. In the folder of a mission of the same
// vehicle and dive the files stay, and its configuration is returned. Throws InputError for a path that can
// be no folder, one that holds other things than a mission, or the mission of another vehicle or dive, and
// another std::exception when the disk refuses.
MissionConfig prepareMissionFolder(const std::filesystem::path& folder, const MissionConfig& mission,
                                   const StereoRig& rig);

// Writes <vehicle>_<start time>.RAW.auv from the log of a mission folder: whole under that name, or not at
// all. `go_on` is asked every 256 samples; when it returns false nothing is written, and false is returned.
// Throws InputError for a log without a sample, or one that cannot be read to its end, and another
// std::exception when the disk refuses.
bool deriveRawAuv(const std::filesystem::path& folder, const std::function<bool()>& go_on = {});

}  // namespace fathom::io
