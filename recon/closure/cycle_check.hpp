#pragma once

#include "recon/closure/registration.hpp"

namespace fathom::closure {

// Squared Mahalanobis distance (6 degrees of freedom) by which two closures a - b and a' - b' of neighbouring
// frames disagree around the cycle a - b - b' - a':
//   e = log((T_a_b T_b_b')^-1 (T_a_a' T_a'_b')),
// against the covariances of both closures and of the two sides, whose ways are short. Two closures that look
// alike in places that are not the same agree by chance alone.
[[nodiscard]] double cycleDistance2(const RelativePrior& a_b, const RelativePrior& b_b2,
                                    const RelativePrior& a_a2, const RelativePrior& a2_b2);

}  // namespace fathom::closure
