#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/colour.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/lighting/range_lattice.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "recon/topside/light/lighting_stage.hpp"

namespace fathom::topside {

// Ranges over one camera's images, from what is known in the left camera's frame.
class CameraRanges {
 public:
  CameraRanges(const Camera& camera, const SE3& T_cam_left) : T_cam_left_(T_cam_left), maker_(camera) {}

  // To a plane, bent to points [m]. Until the next call.
  const lighting::RangeLattice& of(const stereo::SeedPlane& plane, std::span<const Eigen::Vector3f> points) {
    const Eigen::Vector3d normal = T_cam_left_.rotation() * plane.normal;
    maker_.fromPlane(normal, plane.distance + normal.dot(T_cam_left_.translation()), ranges_);
    points_.clear();
    for (const Eigen::Vector3f& p : points)
      points_.emplace_back((T_cam_left_ * p.cast<double>()).cast<float>());
    maker_.bendTo(points_, ranges_);
    return ranges_;
  }

 private:
  SE3 T_cam_left_;
  lighting::RangeMaker maker_;
  lighting::RangeLattice ranges_;
  std::vector<Eigen::Vector3f> points_;
};

// The images of one pair at a time, read and corrected for light, with what masks hide filled smoothly. One
// object a thread; both references must outlive it.
class PairImages {
 public:
  PairImages(const MissionInput& input, const LightingModels& models);

  // Reads both images, or the left one alone; false, with error(), when one cannot be read.
  [[nodiscard]] bool read(const ImagePair& pair);
  [[nodiscard]] bool readLeft(const ImagePair& pair) { return readCamera(pair, 0); }
  [[nodiscard]] const std::string& error() const { return error_; }

  // The left image as it was read, until the next one is.
  [[nodiscard]] const ImageView& asRead() const { return files_[0].view; }

  // Corrects the left image alone: 8-bit mono, until the next call.
  [[nodiscard]] ImageView correctLeft(const stereo::SeedPlane& plane);
  // Corrects both by the ranges to a plane, or without ranges; then the views below hold 8-bit mono images.
  void correct(const stereo::SeedPlane& plane);
  void correctWithoutRanges();
  // Whether the left image was taken while the strobes stayed dark.
  [[nodiscard]] bool unlit(const stereo::SeedPlane& plane);
  [[nodiscard]] ImageView left() const;
  [[nodiscard]] ImageView right() const;

  // Reads the image of one camera alone.
  [[nodiscard]] bool readCamera(const ImagePair& pair, std::size_t camera);
  // One camera's image in colour, corrected by the ranges to a plane bent to points, both in the left camera
  // frame. `gain`: how much brighter it is than others of the same ground would be; `water`: by which light
  // falls with range, where that is known better than the lighting model learnt it.
  [[nodiscard]] RgbImage colours(const stereo::SeedPlane& plane, std::span<const Eigen::Vector3f> points,
                                 double gain = 1, const lighting::WaterLaw& water = {},
                                 std::size_t camera = 0);
  // What that image shows of the vehicle; null: nothing.
  [[nodiscard]] const std::shared_ptr<const ImageMask>& mask(std::size_t camera) const {
    return files_[camera].mask;
  }

 private:
  void correctOne(std::size_t camera, const lighting::RangeLattice& ranges, std::vector<std::uint8_t>& mono);

  const MissionInput& input_;
  const StereoRig& rig_;
  const LightingModels& models_;
  std::vector<CameraRanges> ranges_;  // by camera
  std::vector<io::ImageFile> files_;  // by camera
  std::vector<double> exposures_s_;   // of these
  std::vector<std::uint8_t> left_mono_, right_mono_, mosaic_, rgb_;
  std::optional<ColourMatrix> matrix_;
  std::string error_;
};

}  // namespace fathom::topside
