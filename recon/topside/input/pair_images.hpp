#pragma once

#include <string>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/input/image_pairs.hpp"
#include "recon/topside/light/lighting_stage.hpp"

namespace fathom::topside {

// The images of one pair at a time, read and corrected for light. One object a thread.
class PairImages {
 public:
  PairImages(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
             const LightingModels& models);

  // Reads both images; false, with error(), when one cannot be read.
  [[nodiscard]] bool read(const ImagePair& pair);
  [[nodiscard]] const std::string& error() const { return error_; }

  // Corrects what was read by the ranges to a plane; then the views below hold 8-bit mono images.
  void correct(const stereo::SeedPlane& plane);
  [[nodiscard]] ImageView left() const;
  [[nodiscard]] ImageView right() const;

  // The left image in 8-bit RGB, corrected by ranges bent to points in the left camera frame.
  [[nodiscard]] ImageView colours(const std::vector<stereo::StereoPoint>& points);

 private:
  const io::MissionPaths& paths_;
  const io::MissionConfig& mission_;
  const StereoRig& rig_;
  const LightingModels& models_;
  lighting::RigRanges ranges_;
  io::ImageFile left_file_, right_file_;
  std::vector<std::uint8_t> left_, right_, left_mono_, right_mono_, left_rgb_;
  std::string error_;
};

}  // namespace fathom::topside
