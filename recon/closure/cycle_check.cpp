#include "recon/closure/cycle_check.hpp"

#include <Eigen/Dense>

#include "recon/geometry/adjoint.hpp"

namespace fathom::closure {

double cycleDistance2(const RelativePrior& a_b, const RelativePrior& b_b2, const RelativePrior& a_a2,
                      const RelativePrior& a2_b2) {
  const SE3 one = a_b.T_a_b * b_b2.T_a_b, other = a_a2.T_a_b * a2_b2.T_a_b;
  const Matrix6d covariance = carried(b_b2.T_a_b, a_b.covariance) + b_b2.covariance +
                              carried(a2_b2.T_a_b, a_a2.covariance) + a2_b2.covariance;
  const Vector6d off = (one.inverse() * other).log();
  return off.dot(covariance.ldlt().solve(off));
}

}  // namespace fathom::closure
