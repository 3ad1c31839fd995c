#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

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

// A campaign replays many disturbed simulated dives through fathom-onboard and fathom-topside, to find the
// perturbation level at which each requirement fails.
struct CampaignOptions {
  std::filesystem::path out;
  std::filesystem::path programs;   // folder of fathom-onboard and fathom-topside
  std::size_t dives = 144;          // one round is every perturbation at every level
  std::optional<std::size_t> only;  // this dive alone; its mission is kept
  std::uint64_t seed = 1;
  int jobs = 2;
  std::function<void(std::size_t done, std::size_t total)> progress;
};

// Result of one dive. Dives 0 and 1 are undisturbed: 0 with pictures, 1 with features.
struct DiveResult {
  std::size_t dive = 0;
  int perturbation = -1, level = 0;  // -1: undisturbed
  bool pictures = true;
  bool onboard_map = false, topside_map = false;            // features: poses
  double onboard_surface_m = NAN, topside_surface_m = NAN;  // aligned, rms
  double onboard_coverage = NAN, topside_coverage = NAN;
  double onboard_track_m = NAN, topside_track_m = NAN;  // aligned, rms
  double nees = NAN, inside = NAN;  // of topside's poses: mean of 6, and share below chi-square's 95 %
  std::size_t false_closures = 0;   // kept in topside's solution
  std::string trouble;              // last output line of each failed program
  double seconds = 0;
};

// Scenario of a dive; the same for the same seed and dive.
[[nodiscard]] Scenario diveScenario(const CampaignOptions& options, std::size_t dive);
[[nodiscard]] DiveResult planOf(std::size_t dive);

// Requirements that a dive fails, relative to the undisturbed dive of its kind; empty: none.
[[nodiscard]] std::vector<std::string> failedRequirements(const DiveResult& dive,
                                                          const DiveResult& undisturbed);

// Runs the dives that results.jsonl in `out` does not hold yet, appends each result, and writes
// campaign.html. Throws InputError for a folder with other content and for absent programs.
std::vector<DiveResult> runCampaign(const CampaignOptions& options);

void writeCampaignPage(const std::filesystem::path& file, const std::vector<DiveResult>& dives,
                       std::uint64_t seed);

}  // namespace fathom::sim
