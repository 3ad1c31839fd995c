#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

// A range mesh prepared for fusion: the usable triangles and their vertices, relative to the camera centre,
// with each vertex's terms of the weights. One object serves one mesh after another and keeps its memory.
class RangeMesh {
 public:
  // Prepares a mesh in nav; returns the number of triangles left out.
  std::size_t set(const Mesh& mesh, const Eigen::Vector3d& centre, const VolumetricConfig& config);

  struct Vertex {
    Eigen::Vector3d point;  // relative to the camera centre [m]
    float sigma = 0;        // [m]
    float band = 0;         // half width of the ramp here [m]
    float border = 0;       // factor of the weight
    float relief = 0;  // variance of the slopes around, about their mean, without that of the points' noise
    Rgb colour{};
  };
  std::vector<Vertex> vertices;
  std::vector<Eigen::Vector3f> points;  // of the vertices, in single precision
  std::vector<std::array<std::uint32_t, 3>> triangles;

 private:
  void measureRelief();

  std::vector<std::uint32_t> number_;  // of a vertex of the given mesh
  Mesh used_;                          // in nav, for borderWeights
  std::vector<Eigen::Vector3f> normal_sum_;
  std::vector<float> area_sum_, noise_sum_;
};

}  // namespace fathom::fusion
