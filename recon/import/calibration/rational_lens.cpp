#include "recon/import/calibration/rational_lens.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

namespace fathom::topside {
namespace {

constexpr Eigen::Index kSamples = 200;  // between principal point and corner

// Of the side of an image, the part from the principal point to the farther edge [px].
double reach(double principal, int side) {
  constexpr double kSpare = 1.1;  // where the size is not known
  return side == 0 ? kSpare * principal : std::max(principal, side - principal);
}

}  // namespace

double fitRationalLens(Camera& camera, const std::array<double, 3>& d) {
  const Camera lens = camera;
  const auto distorted = [&](double r) {
    const double q = r * r;
    return r * (1 + q * (lens.k1 + q * (lens.k2 + q * lens.k3))) / (1 + q * (d[0] + q * (d[1] + q * d[2])));
  };
  const double corner =
      std::hypot(reach(lens.cx, lens.width) / lens.fx, reach(lens.cy, lens.height) / lens.fy);
  // The undistorted radius of the corner: outwards in steps, as long as the image grows.
  const double step = corner / kSamples;
  double most = 0;
  while (distorted(most) < corner) {
    if (!(distorted(most + step) > distorted(most)) || most > 4 * corner)
      return std::numeric_limits<double>::infinity();
    most += step;
  }
  Eigen::Matrix<double, Eigen::Dynamic, 3> powers(kSamples, 3);
  Eigen::VectorXd shift(kSamples);
  for (Eigen::Index k = 0; k < kSamples; ++k) {
    const double s = static_cast<double>(k + 1) / kSamples;
    powers.row(k) << std::pow(s, 3), std::pow(s, 5), std::pow(s, 7);
    shift(k) = distorted(s * most) - s * most;
  }
  const Eigen::Vector3d fit = powers.colPivHouseholderQr().solve(shift);
  camera.k1 = fit(0) / std::pow(most, 3);
  camera.k2 = fit(1) / std::pow(most, 5);
  camera.k3 = fit(2) / std::pow(most, 7);
  return (powers * fit - shift).cwiseAbs().maxCoeff() * std::max(lens.fx, lens.fy);
}

}  // namespace fathom::topside
