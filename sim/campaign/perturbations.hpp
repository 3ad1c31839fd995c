#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>

#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

// One thing that makes a dive hard, from what every sea has to what none should.
struct Perturbation {
  static constexpr std::size_t kLevels = 4;
  const char* name;
  const char* unit;
  std::array<double, kLevels> levels;
  bool pictures;  // false: it touches navigation alone, and is dived with features in place of pictures
  void (*disturb)(Scenario& scenario, double level);
};

[[nodiscard]] std::span<const Perturbation> perturbations();

}  // namespace fathom::sim
