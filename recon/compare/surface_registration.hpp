#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>

#include "recon/compare/plane_frame.hpp"

namespace fathom::compare {

struct SurfaceRegistrationConfig {
  double max_shift = 5.0;  // horizontal, looked for [m]
  bool horizontal = true;  // false: heights alone
  bool tilt = false;       // also a slope between the two
};

// The motion that takes the survey onto the reference: east, north, up [m], and with tilt a slope about
// `centre`: up += tilt . (place - centre).
struct RegistrationOffset {
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  Eigen::Vector2d tilt = Eigen::Vector2d::Zero();    // east, north [m/m]
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // east, north [m]
  [[nodiscard]] double upAt(double east, double north) const {
    return shift.z() + tilt.dot(Eigen::Vector2d(east, north) - centre);
  }
};

struct SurfaceRegistration {
  RegistrationOffset offset;
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();       // of the shift; infinite where unresolved
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of the horizontal shift, where resolved
  Eigen::Vector2d tilt_sigma = Eigen::Vector2d::Zero();
  double correlation = 0;       // of the two terrains without their slopes, at the offset
  double relief = 0;            // standard deviation of the survey's heights without their slope [m]
  int directions_resolved = 0;  // of the horizontal offset: 2; 1: across ridges alone; 0: too flat
  double open_bearing = 0;      // with one direction resolved: the other's bearing from north [rad]
  bool at_limit = false;        // the shift is at max_shift and may be larger
  std::size_t cells = 0;        // compared
  std::string note;             // empty, or what is unresolved and why
};

// Registers two maps in one frame with equal cells on one lattice; the reference should reach max_shift
// further on every side.
//
// First every shift of whole cells, coarse to fine, is tried by the median absolute deviation of heights.
// Then Gauss-Newton with Tukey's weights on
//   r = reference(x + d) - survey(x) - u - t . (x - c).
// The normal matrix pairs the gradients of the survey with those of the reference, so that their independent
// noise gives no information. The covariance is the sandwich of that matrix with the scatter of the scores of
// whole blocks, so that correlated errors of neighbouring cells are not counted twice. A horizontal direction
// counts as resolved when its standard deviation is below half a cell and the terrains correlate; the others
// stay zero. Without a common cell: cells = 0.
[[nodiscard]] SurfaceRegistration registerMaps(const HeightMap& survey, const HeightMap& reference,
                                               const SurfaceRegistrationConfig& config);

}  // namespace fathom::compare
