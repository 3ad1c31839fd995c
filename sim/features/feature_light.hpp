#pragma once

#include <Eigen/Core>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "sim/sea/light/water_light.hpp"
#include "sim/sea/optics.hpp"

namespace fathom::sim {

// How well a picture would show the texture at a place: the strobes' light at a pixel of the left camera, as
// Renderer computes it but without shadows and backscatter, against shot and read noise.
class FeatureLight {
 public:
  // `contrast`: standard deviation of the texture by the albedo. Throws std::invalid_argument when no strobe
  // lights the point that the exposure is set by.
  FeatureLight(const OpticsConfig& optics, const SE3& T_body_cam, double contrast);

  // Standard deviation of the texture over that of a pixel's noise. `point` and unit `normal` in body.
  [[nodiscard]] double contrastOverNoise(const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
                                         double albedo) const;

 private:
  [[nodiscard]] double radiance(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const;

  OpticsConfig optics_;
  SE3 T_body_cam_;
  double contrast_;
  Attenuation attenuation_;
  std::vector<Beam> beams_;
  double electrons_ = 0;  // of a white surface per unit of radiance
};

}  // namespace fathom::sim
