#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/colour_matrix.hpp"
#include "recon/geometry/rgb_image.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/input/images/image_pairs.hpp"
#include "recon/topside/light/lighting_stage.hpp"

namespace fathom::topside {

// The images of one pair at a time, read and corrected for light, with what masks hide filled smoothly. One
// object a thread; both references must outlive it.
class PairImages {
 public:
  PairImages(const MissionInput& input, const LightingModels& models);

  // Reads both images, or the left one alone; false, with error(), when one cannot be read.
  [[nodiscard]] bool read(const ImagePair& pair);
  [[nodiscard]] bool readLeft(const ImagePair& pair);
  [[nodiscard]] const std::string& error() const { return error_; }

  // The left image as it was read, until the next one is.
  [[nodiscard]] const ImageView& asRead() const { return left_file_.view; }

  // What it shows of the vehicle; null: nothing.
  [[nodiscard]] const std::shared_ptr<const ImageMask>& mask() const { return left_file_.mask; }

  // Corrects the left image alone: 8-bit mono, until the next call.
  [[nodiscard]] ImageView correctLeft(const stereo::SeedPlane& plane);
  // Corrects both by the ranges to a plane; then the views below hold 8-bit mono images.
  void correct(const stereo::SeedPlane& plane);
  [[nodiscard]] ImageView left() const;
  [[nodiscard]] ImageView right() const;

  // The left image in colour, corrected by the ranges to a plane bent to points in the left camera frame.
  // `gain`: how much brighter it is than others of the same ground would be.
  [[nodiscard]] RgbImage colours(const stereo::SeedPlane& plane, std::span<const Eigen::Vector3f> points,
                                 double gain = 1);

 private:
  [[nodiscard]] bool readOne(const std::string& name, CameraSide side, io::ImageFile& file);

  const MissionInput& input_;
  const StereoRig& rig_;
  const LightingModels& models_;
  lighting::RigRanges ranges_;
  lighting::RangeMaker left_ranges_;
  io::ImageFile left_file_, right_file_;
  std::vector<std::uint8_t> left_, right_, left_mono_, right_mono_;
  std::optional<ColourMatrix> matrix_;
  std::string error_;
};

}  // namespace fathom::topside
