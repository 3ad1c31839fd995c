#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission.hpp"
#include "firmware_if/pose_files.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

struct InputOptions {
  std::filesystem::path calib;  // instead of the folder's own
  std::filesystem::path poses;  // stereo_pose_est.data: poses are taken from there, nothing is localised
  bool verify = false;          // images are told apart by content, not by name, size and time of change
};

// A recorded dive and what is known about it: a mission folder, or images with a calibration and poses or a
// RAW.auv as the ACFR's vehicles leave them.
struct MissionInput {
  io::MissionPaths paths{""};
  io::MissionConfig mission;
  StereoRig rig;
  bool features_only = false;
  std::optional<io::StereoPoseFile> given_poses;
  std::vector<std::string> assumed;  // what no file says, a line each
  bool verify = false;
  Digest identity;  // of all files but the images: calibration, log, poses, names of images

  // Of one pair's images (or feature file), as far as `verify` wants to know them; of absent ones too.
  [[nodiscard]] Digest imageIdentity(const std::string& left, const std::string& right) const;
};

// Into the keys of results: the calibration and the mission's mounting and formats; a pose.
void addRig(Hasher& hasher, const MissionInput& input);
void addPose(Hasher& hasher, const SE3& pose);

// Throws InputError for a folder without images or features, without calibration, or without mission.toml,
// poses and RAW.auv.
[[nodiscard]] MissionInput openMission(const std::filesystem::path& folder, const InputOptions& options);

}  // namespace fathom::topside
