#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "recon/fusion/kernels/fusion_kernels.hpp"
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

// Free space in front of a camera: a coarse picture, from the camera centre, of the depth along the view's
// axis up to which the water is empty. It is conservative: a cell holds the least depth of all triangles near
// it, and cells next to one without triangles hold none. All points are relative to the camera centre. One
// object serves one mesh after another.
class SightMap {
 public:
  // Begins an empty picture that covers the points.
  void begin(const std::vector<Eigen::Vector3f>& points);
  // A triangle that begins `band` [m] before its surface; `weight` [1/m^2]. Its corners are three of the
  // points, by number.
  void add(const std::array<std::uint32_t, 3>& corners, float band, float weight);
  // Call after the last add().
  void close();

  [[nodiscard]] const SightPicture& picture() const { return picture_; }
  // True only if no part of a ball is known to be empty; can be false for such balls too.
  [[nodiscard]] bool surelyUnknown(const Eigen::Vector3f& middle, float radius) const;

 private:
  static constexpr int kSize = SightPicture::kSize;
  struct InView {
    float column = 0, row = 0, depth = 0;  // depth 0: outside the picture
  };
  SightPicture picture_{};
  std::vector<InView> in_view_;
};

}  // namespace fathom::fusion
