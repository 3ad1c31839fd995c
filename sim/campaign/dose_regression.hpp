#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace fathom::sim {

// Two perturbations whose effects together differ from their sum.
struct PairEffect {
  std::size_t a = 0, b = 0;
  double effect = 0;  // on the result at dose 1 of both, beyond their own effects
};

// What doses of perturbations add to a result, from dives that had all of them.
struct DoseEffects {
  double constant = 0;            // result at doses 0
  Eigen::VectorXd effect, sigma;  // of a dose of 1 of each, and its standard deviation
  // Worse together than 19 of 20 times any pair is in results of another order, the worst first.
  std::vector<PairEffect> pairs;
};

// `doses`: dives x perturbations; `result`: of each dive. Ridge regression (Hoerl and Kennard 1970) whose
// penalty has the least error of prediction with each dive left out (Golub, Heath and Wahba 1979). Empty
// members below kFewestDives dives.
inline constexpr Eigen::Index kFewestDives = 10;
[[nodiscard]] DoseEffects regressDoses(const Eigen::MatrixXd& doses, const Eigen::VectorXd& result);

}  // namespace fathom::sim
