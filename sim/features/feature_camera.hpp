#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_feature_frame.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/features/feature_config.hpp"
#include "sim/sea/optics.hpp"
#include "sim/sea/sea_terrain.hpp"

namespace fathom::sim {

// Simulates the matched features of a stereo pair without rendering it: landmarks of the terrain that both
// cameras see, projected through the rig's distortion, tested for occlusion, with the noise of matching.
//   left  = project(P) + J_l (shared + place),
//   right = project(T P) + J_r (shared + place) + match - shared disparity,
// where `place` is the landmark's place in this view (its own part and a smooth field over the image),
// `shared` the errors of calibration and lighting that stay for the whole dive. Each landmark has a detection
// probability p. With the ratio c of contrast to pixel noise, v = c^2 / (c^2 + half_contrast^2), it is
// detected with probability p v, and its standard deviations grow by 1 / sqrt(v).
// Landmarks are on surfaces visible from above: walls, undersides of overhangs and moving objects have none.
class FeatureCamera {
 public:
  // `terrain` must outlive the camera. `seed`: of the dive. Throws std::invalid_argument for optics that
  // light nothing, InputError for a file of match errors that is none.
  FeatureCamera(const SeaTerrain& terrain, const SimulatedFeatureConfig& config, const OpticsConfig& optics,
                const StereoRig& rig, const SE3& T_body_cam, std::uint64_t seed);
  ~FeatureCamera();

  struct Observation {
    StereoFeatureFrame frame;
    std::vector<Eigen::Vector3d> points;     // true position of each feature's landmark, nav [m]
    std::vector<std::uint64_t> keys;         // identity of each landmark
    std::vector<std::uint64_t> appearances;  // equal for landmarks of equal appearance
  };
  // `view_seed`: one for each pair. Thread-safe; the result depends on the arguments only.
  [[nodiscard]] Observation observe(const SE3& T_nav_body, std::uint64_t view_seed) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim
