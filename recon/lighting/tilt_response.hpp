#pragma once

#include <Eigen/Core>

#include "recon/lighting/range_lattice.hpp"

namespace fathom::lighting {

// How much more light a patch of ground returns than one at the same place that lies square to the camera's
// axis: n . (c - p) / z for a Lambertian patch at p (depth z) with unit normal n (towards the camera) in the
// light of lamps whose effective place is c, level with the camera. Of c the two coordinates across the axis
// are learnt, and how strongly tilt matters at all: normals from stereo are smoother than the ground. Least
// squares over what patches returned against what was expected of their place and range; linear in the three
// unknowns, with a prior of a lamp at the camera.
class TiltResponse {
 public:
  // `ratio`: light seen over the light expected there of square ground. Gross ones are passed over.
  void add(const RangeLattice::Ground& ground, float ratio);
  void solve();
  // What was added counts half from here on.
  void halve();

  // Within kDarkest and kBrightest: beyond, lamps graze the ground and no model holds.
  [[nodiscard]] float at(const RangeLattice::Ground& ground) const;
  static constexpr float kDarkest = 0.35F, kBrightest = 1.6F;

  [[nodiscard]] float strength() const { return solution_.x(); }              // 1: Lambert's law
  [[nodiscard]] Eigen::Vector2f lamp() const { return solution_.tail<2>(); }  // camera frame [m]

  // For saved state (state_archive.hpp).
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    for (auto& value : self.normal_.reshaped()) archive(value);
    for (auto& value : self.right_.reshaped()) archive(value);
    for (auto& value : self.solution_.reshaped()) archive(value);
  }

 private:
  Eigen::Matrix3d normal_ = Eigen::Matrix3d::Zero();  // of the least squares
  Eigen::Vector3d right_ = Eigen::Vector3d::Zero();
  Eigen::Vector3f solution_{1, 0, 0};
};

}  // namespace fathom::lighting
