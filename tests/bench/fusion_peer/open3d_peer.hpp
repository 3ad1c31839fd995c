#pragma once

#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::fusion {

// A picture of depths along the optical axis [m], 0 where there is no surface, through a pinhole without
// distortion, and of grey levels.
struct DepthImage {
  Camera camera;
  std::vector<float> depth;
  std::vector<std::uint8_t> rgb;
  SE3 T_nav_cam;
};
// `camera` is made `factor` times as large and stripped of its distortion.
[[nodiscard]] DepthImage drawDepth(const Mesh& mesh, const SE3& T_nav_cam, const Camera& camera,
                                   double factor);

// Open3D's ScalableTSDFVolume over the same meshes as depth images; one thread.
struct PeerRun {
  double integrate_ms = 0, extract_ms = 0;  // CPU: a mesh; all
  Mesh mesh;
};
[[nodiscard]] PeerRun fuseWithOpen3d(const std::vector<DepthImage>& images, double voxel, double truncation);

}  // namespace fathom::fusion
