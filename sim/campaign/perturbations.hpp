#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

// When, where and to which side a perturbation acts.
struct Occasion {
  double at_s = 70;  // since the mission's start
  double sign = 1;
  double north_m = 0.5, east_m = 0.5;  // in nav
};

// One disturbance of a dive.
struct Perturbation {
  static constexpr std::size_t kLevels = 4;
  const char* name;
  const char* unit;
  double none;                         // level that disturbs nothing
  double usual;                        // level that nine of ten dives of a user stay below
  std::array<double, kLevels> levels;  // from usual to extreme
  bool
      pictures;  // false: it affects navigation alone; a dive with it alone has features in place of pictures
  void (*disturb)(Scenario& scenario, double level, const Occasion& occasion);

  // Level of a dose: 0 is none, 1 the usual level; linear, or in a ratio where `none` is not 0. Never beyond
  // the extreme level.
  [[nodiscard]] double levelOf(double dose) const;
};

[[nodiscard]] std::span<const Perturbation> perturbations();

}  // namespace fathom::sim
