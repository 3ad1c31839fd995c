#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>

#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

// One disturbance of a dive, in levels from usual to extreme.
struct Perturbation {
  static constexpr std::size_t kLevels = 4;
  const char* name;
  const char* unit;
  std::array<double, kLevels> levels;
  bool pictures;  // false: it affects navigation alone; the dive has features in place of pictures
  void (*disturb)(Scenario& scenario, double level);
};

[[nodiscard]] std::span<const Perturbation> perturbations();

}  // namespace fathom::sim
