#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "sim/campaign/perturbations.hpp"
#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

// kSingle: dives of one perturbation each, by levels. kTune, kJudge: dives of all perturbations together,
// each with a dose of its own; these two share no random number.
enum class DiveSeries : std::uint8_t { kSingle, kTune, kJudge };
inline constexpr const char* kDiveSeries[] = {"single", "tune", "judge"};
[[nodiscard]] constexpr const char* nameOf(DiveSeries series) {
  return kDiveSeries[static_cast<std::size_t>(series)];
}

// What a dive is of. kSingle: dives 0 and 1 are undisturbed, 0 with pictures, 1 with features. Else dives 0
// to kSites - 1 are undisturbed, each at a site of its own, to which the later dives return in turn.
inline constexpr std::size_t kSites = 20;
struct DivePlan {
  DiveSeries series = DiveSeries::kSingle;
  std::size_t dive = 0;
  bool undisturbed = false;
  int perturbation = -1, level = 0;  // of kSingle; -1: none, or all
  bool pictures = true;              // else features
};
[[nodiscard]] DivePlan planOf(DiveSeries series, std::size_t dive);
// The undisturbed dive that a dive is compared with.
[[nodiscard]] std::size_t undisturbedOf(const DivePlan& plan);

// Dose of each of perturbations() (1: the usual level): of an exponential distribution with a tenth beyond 1;
// all 0 for an undisturbed dive, empty for kSingle.
[[nodiscard]] std::vector<double> dosesOf(const DivePlan& plan, std::uint64_t seed);

// Scenario of a dive; the same for the same plan and seed.
[[nodiscard]] Scenario diveScenario(const DivePlan& plan, std::uint64_t seed);

}  // namespace fathom::sim
