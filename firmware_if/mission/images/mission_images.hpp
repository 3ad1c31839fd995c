#pragma once

#include <filesystem>
#include <string>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// The images of a mission, of the formats, bits and sizes that its mission.toml and calibration say.
// Thread-safe.
class MissionImages {
 public:
  MissionImages(const MissionPaths& paths, const MissionConfig& mission, const StereoRig& rig)
      : folder_(paths.images()), cameras_(mission.cameras), left_(rig.left), right_(rig.right) {}

  // Throws InputError, which names the file, for one that is absent, damaged or other than that.
  [[nodiscard]] ImageFile read(const std::string& name, CameraSide side) const {
    const bool is_left = side == CameraSide::kLeft;
    const Camera& camera = is_left ? left_ : right_;
    return readImage(folder_ / name, is_left ? cameras_.left_format : cameras_.right_format, cameras_.bits,
                     camera.width, camera.height);
  }

 private:
  std::filesystem::path folder_;
  MissionConfig::Cameras cameras_;
  Camera left_, right_;
};

}  // namespace fathom::io
