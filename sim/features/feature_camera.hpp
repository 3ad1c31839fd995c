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
#include "sim/sea/terrain.hpp"

namespace fathom::sim {

// What stereo matching would find in a pair of pictures that nobody takes: landmarks of the terrain that both
// cameras see, through the rig's distortion, not hidden by anything, with the noise that matching leaves.
//   left  = project(P) + J_l (shared + place),
//   right = project(T P) + J_r (shared + place) + match - shared disparity,
// where `place` is the landmark's place in this view (its own part and a smooth field over the image),
// `shared` what calibration and lamps leave in the whole dive. Landmarks are detected with their own
// probability, less often and less well in dim light: contrast c over the noise of a pixel gives the part
// c^2 / (c^2 + half_contrast^2), and standard deviations wider by its root.
// Landmarks lie on what is seen from above: walls and the undersides of overhangs carry none. Things that
// move carry none.
class FeatureCamera {
 public:
  // `terrain` must outlive the camera. `seed`: of the dive. Throws std::invalid_argument for optics that
  // light nothing.
  FeatureCamera(const Terrain& terrain, const FeatureConfig& config, const OpticsConfig& optics,
                const StereoRig& rig, const SE3& T_body_cam, std::uint64_t seed);
  ~FeatureCamera();

  struct Observation {
    StereoFeatureFrame frame;
    std::vector<Eigen::Vector3d> points;  // where each feature's landmark truly lies, nav [m]
    std::vector<std::uint64_t> keys;      // which landmark each is
    std::vector<std::uint64_t> looks;     // what each looks like: the same for look-alikes
  };
  // `view_seed`: one for each pair. Thread-safe; the result depends on the arguments only.
  [[nodiscard]] Observation observe(const SE3& T_nav_body, std::uint64_t view_seed) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim
