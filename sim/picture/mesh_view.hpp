#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "recon/geometry/mesh.hpp"
#include "sim/picture/picture.hpp"

namespace fathom::sim {

// A parallel projection that shows a whole mesh.
struct MeshView {
  Eigen::Vector3f right, down, forward;  // unit, of the picture, in nav
  Eigen::Vector3f corner;                // nav point of pixel (0, 0)'s corner, in front of everything
  float px_per_m = 1;
  float depth_m = 1;  // along `forward` from in front of the mesh to behind it
};

// Leaves `margin_right_px` free for a legend and a border all around.
[[nodiscard]] MeshView fitView(const Mesh& mesh, const PictureOptions& options, int margin_right_px);

// The shaded picture, BGR. Mesh without colours: coloured by depth between `shallow_m` and `deep_m`.
[[nodiscard]] cv::Mat shadeMesh(const Mesh& mesh, const MeshView& view, const PictureOptions& options,
                                float shallow_m, float deep_m);

// Colour of a part of the depth range, 0 shallow to 1 deep: bright to dark, even steps to the eye (viridis).
[[nodiscard]] Rgb depthColour(float part);

}  // namespace fathom::sim
