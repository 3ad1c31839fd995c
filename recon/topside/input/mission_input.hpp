#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/import/control_points.hpp"
#include "recon/import/images/image_masks.hpp"
#include "recon/import/images/image_samples.hpp"
#include "recon/import/images/stereo_files.hpp"
#include "recon/import/navigation/nav_data.hpp"
#include "recon/topside/input/colour_cameras.hpp"
#include "recon/topside/input/region.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

struct InputOptions {
  std::filesystem::path calib = {};       // instead of the folder's own, in any form of readCalibration()
  std::optional<double> calib_unit = {};  // of its lengths [m], where it does not say
  std::filesystem::path poses = {};  // stereo_pose_est.data: poses are taken from there, nothing is localised
  std::filesystem::path control = {};  // of control points; none: the folder's control/, where there is one
  std::string control_crs = {};        // of their eastings and northings, as EPSG:32755
  std::filesystem::path masks = {};    // of images; none: the folder's masks/, where there is one
  std::filesystem::path region = {};   // polygons that the model keeps to; none: the folder's region.geojson
  ColourCameraOptions colour = {};     // beside the pair
  bool verify = false;  // images are distinguished by content, not by name, size and time of change
  // Of a folder without mission.toml.
  StereoFileOptions files = {};                             // without images: those in the folder
  std::string left_format = "auto", right_format = "auto";  // of sampleNames()
  NavFileOptions nav = {};
  std::vector<double> mount =
      {};  // camera in body: roll, pitch, heading [deg], and x, y, z [m]; 0: looks down
};

// A recorded dive and what is known about it: a mission folder, or images of any kind with a calibration and
// with poses, a RAW.auv, navigation tables or none of these.
struct MissionInput {
  io::MissionPaths paths{""};
  io::MissionConfig mission;
  StereoRig rig;
  std::optional<Eigen::Matrix3d> colours;  // of the left camera, to sRGB: see colour.hpp
  bool features_only = false;
  std::optional<io::StereoPoseFile> given_poses;
  std::optional<ControlPoints> control;
  Digest control_identity;  // of its tables
  std::shared_ptr<const ImageMasks> masks;
  Digest mask_identity;  // of those of all images
  std::vector<ColourCamera> colour_cameras;
  std::shared_ptr<const Region> region;  // null: all that was seen is modelled
  std::vector<std::string> assumed;      // what no file says, a line each
  // Without mission.toml: the images where their names tell the pairs, relative to paths.images(), and what
  // they hold.
  bool described = true;
  bool navigated = true;            // by a log, or by poses that were given
  std::optional<NavData> nav_data;  // of --nav files, when not `navigated`
  bool mounted = false;             // --mount gives T_body_cam
  bool placed = true;               // nav's origin is known on the Earth; else it is arbitrary
  std::optional<StereoFiles> files;
  std::array<Samples, 2> samples = {Samples::kAuto, Samples::kAuto};
  bool verify = false;
  Digest identity;  // of all files but the images: calibration, log, poses, names of images

  [[nodiscard]] std::optional<Geodetic> origin() const {
    return placed ? std::optional(mission.origin) : std::nullopt;
  }

  // Whether images have their times; else they are half a second apart.
  [[nodiscard]] bool timed() const { return !files || files->pairs.front().utc_ns.has_value(); }

  // Cameras are numbered: 0 left, 1 right, from 2 on the colour cameras.
  [[nodiscard]] std::size_t cameras() const { return 2 + colour_cameras.size(); }
  [[nodiscard]] const Camera& camera(std::size_t number) const;
  [[nodiscard]] SE3 T_cam_left(std::size_t number) const;
  [[nodiscard]] PixelFormat format(std::size_t number) const;
  [[nodiscard]] int bits(std::size_t number) const;

  // An image of the formats, bits and size that mission and calibration say. Throws InputError, which names
  // the file, for one that is absent, damaged or other than that. Thread-safe.
  [[nodiscard]] io::ImageFile image(const ImagePair& pair, std::size_t camera) const;

  // Of one pair's images and masks (or feature file), as far as `verify` wants to know them; of absent ones
  // too.
  [[nodiscard]] Digest imageIdentity(const ImagePair& pair) const;
};

// Prints MissionInput::assumed to stderr, a line each.
void sayAssumed(const MissionInput& input);
// Adds calibration, mounting and formats to a result's key.
void addRig(Hasher& hasher, const MissionInput& input);
void addPose(Hasher& hasher, const SE3& pose);

// What it assumed, calibration included, is in MissionInput::assumed; sayAssumed() prints it.
// Throws InputError for a folder without images or features or without calibration, for a log without
// mission.toml, and for inputs that contradict each other.
[[nodiscard]] MissionInput openMission(const std::filesystem::path& folder, const InputOptions& options);

}  // namespace fathom::topside
