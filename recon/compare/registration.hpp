#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>

#include "recon/compare/height_map.hpp"

namespace fathom::compare {

struct RegistrationConfig {
  double max_shift = 5.0;  // horizontal, looked for [m]
  bool horizontal = true;  // false: heights alone
  bool tilt = false;       // also a slope between the two
};

// The motion that takes the survey onto the reference: east, north, up [m], and with tilt a slope about
// `centre`: up += tilt . (place - centre).
struct Offset {
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  Eigen::Vector2d tilt = Eigen::Vector2d::Zero();    // east, north [m/m]
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // east, north [m]
  [[nodiscard]] double upAt(double east, double north) const {
    return shift.z() + tilt.dot(Eigen::Vector2d(east, north) - centre);
  }
};

struct Registration {
  Offset offset;
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();       // of the shift; infinite where it was not told
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of the horizontal shift, where it was told
  Eigen::Vector2d tilt_sigma = Eigen::Vector2d::Zero();
  double correlation = 0;   // of the two terrains without their slopes, at the offset
  double relief = 0;        // standard deviation of the survey's heights without their slope [m]
  int directions_told = 0;  // of the horizontal offset: 2; 1: across ridges alone; 0: too flat
  double open_bearing = 0;  // with one direction told: the other's bearing from north [rad]
  bool at_limit = false;    // the shift lies at max_shift: it may be larger
  std::size_t cells = 0;    // compared
  std::string note;         // empty, or what could not be told and why
};

// Both maps in one frame with equal cells that lie on one lattice; the reference should reach max_shift
// further on every side.
//
// First every shift of whole cells, coarse to fine, is tried by the median absolute deviation of heights.
// Then Gauss-Newton with Tukey's weights on
//   r = reference(x + d) - survey(x) - u - t . (x - c),
// whose normal matrix pairs the gradients of the one with those of the other, so that noise, which they do
// not share, carries no information. The covariance is the sandwich of that matrix with the scatter of the
// scores of whole blocks, so neighbouring cells that err together are not counted twice. A horizontal
// direction counts as told when its standard deviation is below half a cell and the terrains correlate; the
// others stay zero. Without a common cell: cells = 0.
[[nodiscard]] Registration registerMaps(const HeightMap& survey, const HeightMap& reference,
                                        const RegistrationConfig& config);

}  // namespace fathom::compare
