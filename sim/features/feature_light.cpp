#include "sim/features/feature_light.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace fathom::sim {

FeatureLight::FeatureLight(const OpticsConfig& optics, const SE3& T_body_cam, double contrast)
    : optics_(optics),
      T_body_cam_(T_body_cam),
      contrast_(contrast),
      attenuation_(optics.water),
      beams_(optics.strobes.begin(), optics.strobes.end()) {
  const Eigen::Vector3d axis = T_body_cam.rotation() * Eigen::Vector3d::UnitZ();
  const double reference =
      radiance(T_body_cam.translation() + optics.sensor.exposure_distance_m * axis, -axis);
  if (!(reference > 0))
    throw std::invalid_argument(
        "optics: no strobe lights the point at sensor.exposure_distance_m under the camera");
  electrons_ = optics.sensor.exposure * optics.sensor.full_well_electrons / reference;
}

double FeatureLight::radiance(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const {
  const Channels& q = optics_.sensor.quantum_efficiency;
  const double range = (point - T_body_cam_.translation()).norm();
  double sum = 0;
  for (std::size_t s = 0; s < beams_.size(); ++s) {
    const StrobeConfig& strobe = optics_.strobes[s];
    const Eigen::Vector3d from = point - strobe.position_body;
    const double d = from.norm();
    const double cosine = std::max(0.0, -from.dot(normal) / d);
    const auto off_axis = static_cast<float>(from.dot(strobe.direction_body.normalized()) / d);
    const Radiance left = attenuation_(static_cast<float>(d + range));
    double mono = 0;
    for (std::size_t c = 0; c < 3; ++c) mono += q[c] * static_cast<double>(left[c]);
    sum += static_cast<double>(beams_[s](off_axis)) * cosine / (d * d) * mono / (q[0] + q[1] + q[2]);
  }
  return sum;
}

double FeatureLight::contrastOverNoise(const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
                                       double albedo) const {
  const Eigen::Vector3d sight = (T_body_cam_.inverse() * point).normalized();
  const double vignetting = std::pow(std::max(sight.z(), 0.0), optics_.sensor.vignetting_power);
  const double electrons = std::min(electrons_ * albedo * vignetting * radiance(point, normal),
                                    optics_.sensor.full_well_electrons);
  const double read = optics_.sensor.read_noise_electrons;
  return contrast_ * electrons / std::sqrt(electrons + read * read);
}

}  // namespace fathom::sim
