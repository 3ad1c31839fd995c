#pragma once

#include <optional>
#include <span>
#include <string>

#include "firmware_if/files/mission.hpp"
#include "recon/geometry/rgb_image.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/range_lattice.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/input/image_pairs.hpp"
#include "recon/topside/light/lighting_stage.hpp"

namespace fathom::topside {

// The left images of a mission for the model's texture: read without their partners, corrected for light and
// in colour. One object a thread.
class LeftImages {
 public:
  LeftImages(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
             const LightingModels& models);

  // `plane` and `points` (left camera frame [m], stereo's; may be none) say how far the seafloor is. Nothing,
  // with error(), when the image cannot be read.
  [[nodiscard]] std::optional<RgbImage> read(const ImagePair& pair, const stereo::SeedPlane& plane,
                                             std::span<const Eigen::Vector3f> points);
  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  const io::MissionPaths& paths_;
  const io::MissionConfig& mission_;
  const StereoRig& rig_;
  const LightingModels& models_;
  lighting::RangeMaker ranges_;
  std::vector<std::uint8_t> corrected_;
  std::string error_;
};

}  // namespace fathom::topside
